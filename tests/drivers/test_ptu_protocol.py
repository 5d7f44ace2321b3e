"""What a pan-tilt unit says, as bytes: terse, verbose, echoed, interrupted, in pieces, garbage."""

import pytest

from hypermask_drivers.pantilt.ptu_protocol import Reader


@pytest.mark.parametrize(
    ("line", "number"),
    [
        (b"* -907\r\n", -907.0),
        (b"* Minimum Tilt position is -907\r\n", -907.0),
        (b"* 185.1428 seconds arc per Pan position\r\n", 185.1428),
        (b"PP * 22\r\n", 22.0),
        (b"!P* 22\r\n", 22.0),
        (b"*22\r\n", None),
        (b"* 3x34\r\n", None),
        (b"*\r\n", None),
        (b"! Maximum allowable Pan position is 3090\r\n", None),
    ],
)
def test_terse_verbose_echoed_and_interrupted_answers(line: bytes, number: float | None) -> None:
    answers = Reader().feed(line, "PP ")
    assert [answer.number for answer in answers] == ([] if line == b"*22\r\n" else [number])


def test_an_answer_in_pieces_is_one_answer() -> None:
    reader = Reader()
    pieces = [b"* Cur", b"rent Pan posi", b"tion is 4", b"2\r", b"\n"]
    found = [answer for piece in pieces for answer in reader.feed(piece)]
    assert [answer.number for answer in found] == [42.0]


def test_banners_and_garbage_are_no_answers() -> None:
    reader = Reader()
    assert reader.feed(b"### Pan-Tilt Controller v2\r\n\xff\x81*!x\r\n") == []
    assert len(reader.unexpected) == 2


def test_the_end_of_a_reset_is_four_limit_hits_and_one_success() -> None:
    reader = Reader()
    (answer,) = reader.feed(b"!T!T!P!P*\r\n")
    assert answer.good and reader.limit_hits == "TTPP"


def test_garbage_without_end_does_not_fill_the_memory() -> None:
    reader = Reader()
    for _ in range(100):
        reader.feed(b"x" * 1000)
    assert sum(map(len, reader.unexpected)) < 20_000
