"""`python3 -m hypermask.services NAME`."""

import gc
import os
import sys


def _main() -> int:
    gc.disable()  # until all is loaded: there is nothing to collect, and it takes its time
    # Before numpy is imported: small linear algebra gets slower with BLAS threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if sys.argv[1:] == ["stage"]:
        from hypermask.services.warm import go_first, warm_up_graphics

        go_first()

        # Software GL draws steadier without threads of its own.
        os.environ.setdefault("LP_NUM_THREADS", "0")
        warm_up_graphics()
    from hypermask.services.service import main

    return main(sys.argv[1:])


if __name__ == "__main__":
    code = _main()
    sys.stderr.flush()
    os._exit(
        code
    )  # all is in order; taking the interpreter to pieces may take longer than a second
