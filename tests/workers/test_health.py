"""Each worker's own record: what it did, how quickly, and how often it began anew."""

from __future__ import annotations

from pathlib import Path

import pytest

from hypermask.workers.health import Health, Healths, topic
from hypermask_drivers.clock import VirtualClock


def test_the_record_tells_of_work_and_of_its_latency(tmp_path: Path) -> None:
    clock = VirtualClock(10.0)
    health = Health(tmp_path, "tracker", clock)
    for latency_s in (0.001, 0.002, 0.050):
        clock.sleep_until(clock.now() + 1)
        health.worked(latency_s, missed=1)
    health.publish(now=True)
    record = Healths(tmp_path).all()["tracker"]
    assert (record["steps"], record["missed"], record["started_s"]) == (3, 3, 10.0)
    assert (record["first_s"], record["work_s"]) == (11.0, 13.0)
    assert record["p50_ms"] == pytest.approx(2.0) and record["max_ms"] == pytest.approx(50.0)


def test_the_record_is_written_twice_a_second(tmp_path: Path) -> None:
    clock = VirtualClock()
    health = Health(tmp_path, "voice", clock)
    seen = topic(tmp_path, "voice")
    times = []
    for tick in range(20):
        clock.sleep_until(0.1 * tick)
        health.publish()
        record = seen.latest()
        assert record is not None
        times.append(float(record["time_s"]))
    assert len(set(times)) == 4


def test_a_worker_that_begins_anew_counts_it(tmp_path: Path) -> None:
    for restarts in range(3):
        health = Health(tmp_path, "show", VirtualClock())
        health.publish(now=True)
        assert Healths(tmp_path).all()["show"]["restarts"] == restarts


def test_a_device_that_goes_is_counted_once(tmp_path: Path) -> None:
    health = Health(None, "tracker", VirtualClock())
    for ready in (False, True, True, False, False, True, False):
        health.device(ready)
    assert health.record["losses"] == 2 and not health.record["ready"]


def test_the_first_face_is_the_first_flip_that_shows_one() -> None:
    clock = VirtualClock(5.0)
    health = Health(None, "stage", clock)
    health.worked(first=False)
    assert health.record["first_s"] == 0
    clock.sleep_until(6.0)
    health.worked(first=True)
    clock.sleep_until(7.0)
    health.worked(first=True)
    assert health.record["first_s"] == 6.0


def test_the_records_of_another_version_are_left_out(tmp_path: Path) -> None:
    Health(tmp_path, "show", VirtualClock()).publish(now=True)
    path = tmp_path / "health-show"
    data = bytearray(path.read_bytes())
    data[8] ^= 0xFF
    (tmp_path / "health-voice").write_bytes(bytes(data))
    assert list(Healths(tmp_path).all()) == ["show"]
