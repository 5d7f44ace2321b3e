"""The services: one process each, the same on the cart, in a virtual one and on a desk.

`python3 -m hypermask.services NAME`, see `service.NAMES`.
"""
