"""One writer, many readers, never a torn record, in plain files that outlive a process."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hypermask.blackboard import LocalTopic, SharedTopic
from hypermask.errors import HypermaskError
from hypermask.workers.board import LAYOUTS, Board

PAIR = np.dtype([("count", "<u8"), ("same", "<u8", (512,))])


def record(count: int) -> np.ndarray:
    item = np.zeros((), PAIR)
    item["count"] = count
    item["same"] = count
    return item


def test_nothing_published_is_none(tmp_path: Path) -> None:
    assert SharedTopic(tmp_path / "t", PAIR).latest() is None
    assert LocalTopic().latest() is None


def test_a_second_opener_sees_the_newest_record(tmp_path: Path) -> None:
    writer, reader = SharedTopic(tmp_path / "t", PAIR), SharedTopic(tmp_path / "t", PAIR)
    writer.publish(record(1))
    writer.publish(record(2))
    latest = reader.latest()
    assert latest is not None and latest["count"] == 2


def test_a_local_topic_keeps_its_own_copy() -> None:
    topic, item = LocalTopic(), record(1)
    topic.publish(item)
    item["count"] = 9
    latest = topic.latest()
    assert latest is not None and latest["count"] == 1


def test_readers_in_another_process_never_see_a_torn_record(tmp_path: Path) -> None:
    """A writer process publishes 20,000 records whose fields must agree while we read."""
    path = tmp_path / "t"
    reader = SharedTopic(path, PAIR)
    code = (
        "import sys; from pathlib import Path; import numpy as np\n"
        "from hypermask.blackboard import SharedTopic\n"
        "d = np.dtype([('count','<u8'),('same','<u8',(512,))])\n"
        "t = SharedTopic(Path(sys.argv[1]), d)\n"
        "r = np.zeros((), d)\n"
        "for i in range(1, 20001):\n"
        "    r['count'] = i; r['same'] = i; t.publish(r)\n"
    )
    writer = subprocess.Popen([sys.executable, "-c", code, str(path)])
    seen = 0
    while writer.poll() is None or seen < 20000:
        latest = reader.latest()
        if latest is not None:
            assert (latest["same"] == latest["count"]).all()
            assert latest["count"] >= seen
            seen = int(latest["count"])
    assert writer.returncode == 0


def test_a_writer_that_died_in_the_middle_does_not_block_the_next(tmp_path: Path) -> None:
    topic = SharedTopic(tmp_path / "t", PAIR)
    topic.publish(record(1))
    topic._header["sequence"][0] += np.uint64(1)  # died between odd and even
    assert topic.latest() is None
    SharedTopic(tmp_path / "t", PAIR).publish(record(2))
    latest = topic.latest()
    assert latest is not None and latest["count"] == 2


def test_another_versions_file_is_refused(tmp_path: Path) -> None:
    SharedTopic(tmp_path / "t", PAIR)
    with pytest.raises(HypermaskError, match="BOARD-LAYOUT"):
        SharedTopic(tmp_path / "t", np.dtype([("count", "<u8"), ("same", "<f8", (512,))]))


def test_a_lesson_needs_no_right_to_anything_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = os.umask(0o007)  # as systemd/*.service have it
    try:
        Board.shared(tmp_path)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "lesson").stat().st_mode) & 0o020
    assert not stat.S_IMODE((tmp_path / "track").stat().st_mode) & 0o022
    opens = os.open

    def refused(path: Path, flags: int, *mode: int) -> int:
        if flags & os.O_RDWR and Path(path).name != "lesson":
            raise PermissionError(13, "Permission denied")
        return opens(path, flags, *mode)

    monkeypatch.setattr(os, "open", refused)
    board = Board.reading(tmp_path, but="lesson")
    board.lesson.publish(np.zeros((), LAYOUTS["lesson"]))
    assert board.lesson.latest() is not None
    with pytest.raises(TypeError):
        board.mouth.publish(np.zeros((), LAYOUTS["mouth"]))
    with pytest.raises(HypermaskError) as caught:
        Board.shared(tmp_path)
    assert caught.value.code == "BOARD-RIGHTS"
