"""The page of measurements: one section a measurement, and a new one replaces only its own."""

from pathlib import Path

from hypermask.bench.collection import write_page
from hypermask.bench.table import Table


def table(name: str, value: float) -> Table:
    return Table(name, f"About {name}", ("what", "mm"), [("a", value)])


def test_a_section_is_replaced_and_the_others_stay(tmp_path: Path) -> None:
    page = tmp_path / "benchmarks.md"
    write_page([table("still", 1.0), table("paper", 2.0)], page)
    write_page([table("still", 3.0)], page)
    text = page.read_text()
    assert text.count("## About still") == 1 and "| a | 3 |" in text and "| a | 1 |" not in text
    assert "| a | 2 |" in text
    assert text.index("About still") < text.index("About paper")
