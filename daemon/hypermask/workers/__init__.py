"""The workers: each wires one part of the computation to its drivers and to the blackboard.

A worker owns its device, keeps going without it, and asks for it again every second. The same
classes run as processes of their own on the cart and in turn in a lock-step rehearsal.
"""
