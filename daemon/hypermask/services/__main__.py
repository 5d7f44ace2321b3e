"""`python3 -m hypermask.services NAME`."""

import os
import sys

# Before numpy is imported: small linear algebra gets slower with BLAS threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypermask.services.service import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
