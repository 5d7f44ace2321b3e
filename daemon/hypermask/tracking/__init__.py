"""Where the mask is: LED blobs in camera frames -> labels -> pose -> motion, and its prediction."""
