"""`python3 -m hypermask.services NAME`."""

import os
import sys

# Before numpy is imported: small linear algebra gets slower with BLAS threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if sys.argv[1:] == ["stage"]:
    from hypermask.services.warm import warm_up_graphics

    os.environ.setdefault("LP_NUM_THREADS", "0")
    warm_up_graphics()

from hypermask.services.service import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
