"""Bits in, bytes out, and back."""

from __future__ import annotations


class OutOfBits(ValueError):
    """A datagram ends in the middle of something, or says what cannot be."""


class BitWriter:
    def __init__(self) -> None:
        self._value, self._count = 0, 0

    def __len__(self) -> int:
        """Bits so far."""
        return self._count

    def put(self, value: int, bits: int) -> None:
        """`value` as an unsigned number of that many bits."""
        if not 0 <= value < 1 << bits:
            raise ValueError(f"{value} does not fit into {bits} bits")
        self._value = (self._value << bits) | value
        self._count += bits

    def golomb(self, value: int, order: int) -> None:
        """A number from 0 on, small ones in few bits (exponential Golomb code)."""
        shifted = value + (1 << order)
        length = shifted.bit_length()
        self.put(0, length - 1 - order)
        self.put(shifted, length)

    def append(self, other: BitWriter) -> None:
        self.put(other._value, other._count)

    def bytes(self) -> bytes:
        """Filled up with zeros."""
        fill = -self._count % 8
        return (self._value << fill).to_bytes((self._count + fill) // 8, "big")


class BitReader:
    """Raises `OutOfBits` at its end."""

    def __init__(self, data: bytes) -> None:
        self._value, self._left = int.from_bytes(data, "big"), 8 * len(data)

    @property
    def left(self) -> int:
        return self._left

    def get(self, bits: int) -> int:
        if bits > self._left:
            raise OutOfBits("the datagram is too short")
        self._left -= bits
        return (self._value >> self._left) & ((1 << bits) - 1)

    def golomb(self, order: int) -> int:
        zeros = 0
        while self.get(1) == 0:
            zeros += 1
            if zeros > 16:
                raise OutOfBits("a number is too large")
        return (1 << (zeros + order)) - (1 << order) + self.get(zeros + order)
