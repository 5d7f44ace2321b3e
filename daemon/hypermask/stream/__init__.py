"""Mouth, expression and head from one hypermask to another at 10 kbit/s (PAPERS A7's outlook).

Only parameters travel, as UDP datagrams of 80 ms each. A datagram stands for itself: it can be
lost, late, doubled or out of order, and the mouth goes on. Off by default; sound does not travel.
"""
