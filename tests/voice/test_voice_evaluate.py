"""Measuring a model on a table of recorded vowels, and refusing a bad table clearly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from voice_sounds import DATA, needs_data

from hypermask.errors import DataError, UsageError
from hypermask.voice.evaluate import evaluate

HEAD = "file,speaker,group,vowel,start_ms,end_ms\n"


def table(folder: Path, text: str) -> Path:
    (folder / "vowels.csv").write_text(text)
    return folder / "vowels.csv"


@needs_data
@pytest.mark.parametrize("model", ["default", "paper"])
def test_the_result_adds_up(model, tmp_path):
    lines = (DATA / "vowels" / "vowels.csv").read_text().splitlines()
    (tmp_path / "wav").symlink_to(DATA / "vowels" / "wav")
    result = evaluate(
        table(
            tmp_path,
            "\n".join([lines[0], *(row for row in lines[1:] if row.split(",")[1][-1] == "2")]),
        ),
        model,
    )
    confusion = np.array([list(heard.values()) for heard in result["confusion"].values()])
    assert confusion.shape == (5, 6)
    assert confusion.sum() == result["frames"]
    right = sum(heard[spoken] for spoken, heard in result["confusion"].items())
    assert result["frame_accuracy"] == pytest.approx(right / result["frames"])
    assert set(result["groups"]) == {"men", "women", "boys", "girls", "children"}
    assert result["frame_accuracy"] > 0.7
    assert result["note"]


@needs_data
def test_vowels_that_are_none_of_the_five_are_left_out(tmp_path):
    (tmp_path / "wav").symlink_to(DATA / "vowels" / "wav")
    rows = "wav/b01ae.wav,b01,b,ae,72,329\nwav/b01iy.wav,b01,b,iy,120,357\n"
    assert evaluate(table(tmp_path, HEAD + rows))["recordings"] == 1


@needs_data
@pytest.mark.parametrize(("vowels", "count"), [(("eh", "ei"), 1), (("ei",), 1), (("eh", "iy"), 2)])
def test_the_glide_stands_for_e_only_where_the_steady_vowel_is_absent(tmp_path, vowels, count):
    (tmp_path / "wav").symlink_to(DATA / "vowels" / "wav")
    rows = [f"wav/b01{vowel}.wav,b01,b,{vowel},89,273" for vowel in vowels]
    assert evaluate(table(tmp_path, HEAD + "\n".join(rows)))["recordings"] == count


def test_an_unknown_model():
    with pytest.raises(UsageError, match=r"VOICE-MODEL.*default"):
        evaluate(Path("any.csv"), "best")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no column 'file'"),
        ("file,speaker,group,start_ms,end_ms\n", "no column 'vowel'"),
        (HEAD, "none of the vowels"),
        (HEAD + "a.wav,m1,m,xx,0,100\n", "none of the vowels"),
        (HEAD + "a.wav,m1,m,ah,0\n", "truncated at line 2"),
        (HEAD + "a.wav,m1,m,ah,0,100\na.wav,m1,m", "truncated at line 3"),
        (HEAD + "a.wav,m1,m,ah,zero,100\n", "no number at line 2"),
        (HEAD + "a.wav,m1,m,ah,100,50\n", "ends before it starts at line 2"),
        (HEAD + "a.wav,m1,m,ah,nan,50\n", "ends before it starts at line 2"),
    ],
)
def test_a_bad_table_is_named_with_its_fault(tmp_path, text, why):
    with pytest.raises(DataError, match=f"VOICE-CSV.*{why}"):
        evaluate(table(tmp_path, text))


def test_an_absent_table(tmp_path):
    with pytest.raises(DataError, match=r"VOICE-CSV.*does not exist"):
        evaluate(tmp_path / "none.csv")


def test_a_table_that_is_no_text(tmp_path):
    (tmp_path / "vowels.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(DataError, match="VOICE-CSV"):
        evaluate(tmp_path / "vowels.csv")


def test_an_absent_recording(tmp_path):
    with pytest.raises(DataError, match=r"VOICE-WAV.*there is no recording .*a\.wav"):
        evaluate(table(tmp_path, HEAD + "a.wav,m1,m,ah,0,100\n"))


@needs_data
def test_a_truncated_recording(tmp_path):
    whole = (DATA / "vowels" / "wav" / "b01iy.wav").read_bytes()
    (tmp_path / "a.wav").write_bytes(whole[:3000])
    with pytest.raises(DataError, match=r"VOICE-WAV.*truncated"):
        evaluate(table(tmp_path, HEAD + "a.wav,b01,b,iy,120,357\n"))


@needs_data
def test_a_recording_that_ends_before_its_vowel(tmp_path):
    (tmp_path / "a.wav").write_bytes((DATA / "vowels" / "wav" / "b01iy.wav").read_bytes())
    with pytest.raises(DataError, match=r"VOICE-WAV.*before its vowel"):
        evaluate(table(tmp_path, HEAD + "a.wav,b01,b,iy,900,1200\n"))
