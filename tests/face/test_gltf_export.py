"""A character as .glb: what a reader that knows only the glTF 2.0 specification finds in it."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import UsageError
from hypermask.face.arkit import BLENDSHAPES
from hypermask.face.character import Character, load_character
from hypermask.face.emotions import EMOTIONS
from hypermask.face.gltf import export_glb
from hypermask.mask import Mask, load_mask

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


class Reader:
    """Reads what the specification says, and nothing that HYPERMASK knows of its own files."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<III", data)
        assert (magic, version, length) == (0x46546C67, 2, len(data))
        size, kind = struct.unpack_from("<II", data, 12)
        assert kind == 0x4E4F534A and size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        binary, kind = struct.unpack_from("<II", data, 20 + size)
        assert kind == 0x004E4942 and binary % 4 == 0
        self.binary = data[28 + size : 28 + size + binary]
        assert 28 + size + binary == len(data)

    def _part(self, view: int, kind: int, count: int, width: int) -> np.ndarray:
        found = self.json["bufferViews"][view]
        size = count * width * np.dtype(TYPES[kind]).itemsize
        assert size <= found["byteLength"]
        return np.frombuffer(self.binary, TYPES[kind], count * width, found["byteOffset"]).reshape(
            count, width
        )

    def accessor(self, index: int) -> np.ndarray:
        found = self.json["accessors"][index]
        kind, count, width = found["componentType"], found["count"], WIDTHS[found["type"]]
        values = np.zeros((count, width), TYPES[kind])
        if "bufferView" in found:
            values = self._part(found["bufferView"], kind, count, width).copy()
        if "sparse" in found:
            sparse = found["sparse"]
            rows = self._part(
                sparse["indices"]["bufferView"],
                sparse["indices"]["componentType"],
                sparse["count"],
                1,
            )[:, 0].astype(int)
            assert (np.diff(rows) > 0).all() and rows.max() < count
            values[rows] = self._part(sparse["values"]["bufferView"], kind, sparse["count"], width)
        return values

    @property
    def mesh(self) -> dict:
        return self.json["meshes"][0]

    @property
    def names(self) -> list[str]:
        return self.mesh["extras"]["targetNames"]

    def primitive(self, name: str) -> dict:
        materials = [material["name"] for material in self.json["materials"]]
        wanted = materials.index(name)
        return next(p for p in self.mesh["primitives"] if p["material"] == wanted)

    def positions(self, part: str, **weights: float) -> np.ndarray:
        primitive = self.primitive(part)
        places = self.accessor(primitive["attributes"]["POSITION"]).astype(float)
        for name, weight in weights.items():
            target = primitive["targets"][self.names.index(name)]
            places = places + weight * self.accessor(target["POSITION"])
        return places

    def triangles(self, part: str) -> np.ndarray:
        return self.accessor(self.primitive(part)["indices"]).reshape(-1, 3).astype(int)

    def picture(self, part: str) -> np.ndarray:
        material = self.json["materials"][self.primitive(part)["material"]]
        texture = material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
        image = self.json["images"][self.json["textures"][texture]["source"]]
        view = self.json["bufferViews"][image["bufferView"]]
        data = self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        starts = {"image/png": b"\x89PNG", "image/jpeg": b"\xff\xd8"}
        assert data.startswith(starts[image["mimeType"]])
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.fixture(scope="module")
def mask() -> Mask:
    return load_mask(paths.configs() / "masks" / "reference")


@pytest.fixture(scope="module")
def character() -> Character:
    return load_character(paths.configs() / "characters" / "mean")


@pytest.fixture(scope="module")
def arkit(character: Character, mask: Mask) -> Reader:
    return Reader(export_glb(character, mask))


@pytest.fixture(scope="module")
def both(character: Character, mask: Mask) -> Reader:
    return Reader(export_glb(character, mask, "both"))


def _at(reader: Reader, part: str, place_mm: tuple[float, float]) -> int:
    """The vertex nearest to a place on the face at rest."""
    places = reader.positions(part)[:, :2] * 1000
    return int(np.linalg.norm(places - place_mm, axis=1).argmin())


def test_buffers_views_and_accessors_fit_together(both: Reader) -> None:
    assert both.json["asset"]["version"] == "2.0"
    size = both.json["buffers"][0]["byteLength"]
    assert 0 <= len(both.binary) - size < 4
    for view in both.json["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= size
    for index, accessor in enumerate(both.json["accessors"]):
        values = both.accessor(index)
        if accessor["componentType"] == 5126:
            assert np.isfinite(values).all()
        if "min" in accessor:
            np.testing.assert_allclose(accessor["min"], values.min(axis=0), atol=1e-9)
            np.testing.assert_allclose(accessor["max"], values.max(axis=0), atol=1e-9)


def test_every_primitive_has_the_same_targets_with_bounds(both: Reader) -> None:
    names = both.names
    assert len(names) == len(set(names)) == 52 + 44 + 5
    assert both.mesh["weights"] == [0.0] * len(names)
    for primitive in both.mesh["primitives"]:
        count = len(both.accessor(primitive["attributes"]["POSITION"]))
        assert both.accessor(primitive["indices"]).max() < count
        assert len(primitive["targets"]) == len(names)
        for attributes in (primitive["attributes"], *primitive["targets"]):
            assert "min" in both.json["accessors"][attributes["POSITION"]]
            for index in attributes.values():
                assert len(both.accessor(index)) == count


def test_arkit_has_its_52_names_and_no_clip(arkit: Reader) -> None:
    assert set(arkit.names) == set(BLENDSHAPES) and len(arkit.names) == 52
    assert "animations" not in arkit.json


def test_units_come_with_visemes_and_a_clip_for_each_emotion(
    character: Character, mask: Mask
) -> None:
    reader = Reader(export_glb(character, mask, "units"))
    assert next(name for name in reader.names if name.startswith("AU")) == "AU1"
    assert sum(name.startswith("AU") for name in reader.names) == 44
    assert {"viseme_aa", "viseme_E", "viseme_I", "viseme_O", "viseme_U"} <= set(reader.names)
    clips = reader.json["animations"]
    assert [clip["name"] for clip in clips] == list(EMOTIONS)
    for clip in clips:
        times = reader.accessor(clip["samplers"][0]["input"])[:, 0]
        weights = reader.accessor(clip["samplers"][0]["output"]).reshape(len(times), -1)
        assert (np.diff(times) > 0).all() and weights.shape[1] == len(reader.names)
        assert weights[0].max() == weights[-1].max() == 0 and weights[1].max() > 0.3
    happy = dict(zip(reader.names, weights_of(reader, "happiness"), strict=True))
    assert happy["AU12"] > 0.3 and happy["AU15"] == 0


def weights_of(reader: Reader, clip: str) -> np.ndarray:
    sampler = next(c for c in reader.json["animations"] if c["name"] == clip)["samplers"][0]
    return reader.accessor(sampler["output"]).reshape(4, -1)[1]


def test_an_unknown_set_of_blendshapes_is_refused(character: Character, mask: Mask) -> None:
    with pytest.raises(UsageError, match="GLTF-SHAPES"):
        export_glb(character, mask, "all")  # type: ignore[arg-type]


def test_the_face_is_in_metres_upright_and_looks_along_z(arkit: Reader) -> None:
    skin = arkit.positions("skin")
    width, height, depth = np.ptp(skin, axis=0)
    assert 0.12 < width < 0.20 and 0.15 < height < 0.25 and 0.01 < depth < 0.10
    nose = skin[skin[:, 2].argmax()]
    assert abs(nose[0]) < 0.005 and abs(nose[1]) < 0.04, "the nose is foremost"
    eyes, mouth = arkit.positions("eyes"), arkit.positions("mouth")
    assert eyes[:, 1].mean() > nose[1] > mouth[:, 1].mean()


@pytest.mark.parametrize("part", ["skin", "eyes", "upper_teeth", "lower_teeth"])
def test_triangles_are_anticlockwise_seen_from_the_front(arkit: Reader, part: str) -> None:
    places = arkit.positions(part)
    a, b, c = (places[arkit.triangles(part)[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).mean() > 0.99
    normals = arkit.accessor(arkit.primitive(part)["attributes"]["NORMAL"])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    assert (normals[:, 2] > 0).mean() > 0.95


def test_the_texture_is_not_flipped(arkit: Reader) -> None:
    """Sampled where the skin's own coordinates say, with v = 0 the picture's upper edge."""
    picture = arkit.picture("skin")[..., :3].astype(float)
    primitive = arkit.primitive("skin")
    uv = arkit.accessor(primitive["attributes"]["TEXCOORD_0"])
    places = arkit.positions("skin") * 1000
    columns, rows = (np.clip(uv, 0, 1) * (np.array(picture.shape[1::-1]) - 1)).round().astype(int).T
    blue, green, red = picture[rows, columns].T
    redness = red - (green + blue) / 2
    lips = (np.abs(places[:, 0]) < 12) & (np.abs(places[:, 1] + 53) < 6)
    forehead = (np.abs(places[:, 0]) < 30) & (places[:, 1] > 60)
    assert lips.sum() >= 4 and forehead.sum() >= 3
    assert redness[lips].mean() > redness[forehead].mean() + 8
    assert np.corrcoef(uv[:, 0], places[:, 0])[0, 1] > 0.999
    assert np.corrcoef(uv[:, 1], places[:, 1])[0, 1] < -0.999


def test_pictures_are_embedded_and_teeth_are_cut_out(arkit: Reader) -> None:
    assert all("uri" not in image for image in arkit.json["images"])
    assert arkit.picture("skin").shape[:2] == (512, 512)
    assert arkit.picture("upper_teeth").shape[2] == 4
    teeth = next(m for m in arkit.json["materials"] if m["name"] == "upper_teeth")
    assert teeth["alphaMode"] == "MASK"


def test_a_smile_takes_both_corners_out_and_up(arkit: Reader) -> None:
    rest = arkit.positions("skin")
    smile = arkit.positions("skin", mouthSmileLeft=1, mouthSmileRight=1)
    moved = (smile - rest) * 1000
    for side in (-1, 1):
        corner = _at(arkit, "skin", (side * 26, -53))
        assert moved[corner, 0] * side > 2 and moved[corner, 1] > 2
    left = (arkit.positions("skin", mouthSmileLeft=1) - rest) * 1000
    widest = np.linalg.norm(left, axis=1).argmax()
    assert rest[widest, 0] > 0, "the face's left is at +x"


def test_the_jaw_opens_downwards_and_shows_teeth_behind_the_lips(arkit: Reader) -> None:
    rest, opened = arkit.positions("skin"), arkit.positions("skin", jawOpen=1)
    chin = rest[:, 1].argmin()
    assert (opened - rest)[chin, 1] < -0.010
    forehead = rest[:, 1].argmax()
    assert np.abs(opened - rest)[forehead].max() < 1e-5
    for part in ("upper_teeth", "lower_teeth", "mouth"):
        inner = arkit.positions(part, jawOpen=1)
        front = opened[np.linalg.norm(opened[:, :2] - inner[:, None, :2], axis=2).argmin(axis=1), 2]
        assert (inner[:, 2] < front + 1e-4).mean() > 0.97, part


def test_an_eye_looks_and_shuts_alone(arkit: Reader) -> None:
    for name, side in (("eyeLookOutLeft", 1), ("eyeLookUpRight", -1)):
        rest, moved = arkit.positions("eyes"), arkit.positions("eyes", **{name: 1})
        far = np.linalg.norm(moved - rest, axis=1)
        assert far[rest[:, 0] * side > 0].max() > 0.003
        assert far[rest[:, 0] * side < 0].max() == 0
    shut = arkit.positions("skin", eyeBlinkLeft=1) - arkit.positions("skin")
    widest = np.linalg.norm(shut, axis=1).argmax()
    assert arkit.positions("skin")[widest, 0] > 0 and shut[widest, 1] < -0.004


def test_the_tongue_has_no_area_until_it_is_put_out(arkit: Reader) -> None:
    hidden = arkit.positions("tongue")
    assert np.ptp(hidden[:, 0]) < 1e-6
    out = arkit.positions("tongue", tongueOut=1)
    assert np.ptp(out[:, 0]) > 0.01 and np.ptp(out[:, 1]) > 0.004


def test_no_blendshape_turns_a_triangle_over(both: Reader) -> None:
    corners = both.triangles("skin")
    for name in both.names:
        a, b, c = (both.positions("skin", **{name: 1})[corners[:, k], :2] for k in range(3))
        turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        assert turn.min() > -1e-9, name


def test_other_programs_read_it(both: Reader, character: Character, mask: Mask, tmp_path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    file = tmp_path / "face.glb"
    file.write_bytes(export_glb(character, mask))
    scene = trimesh.load(file)
    count = sum(len(mesh.faces) for mesh in scene.geometry.values())
    assert count == sum(len(both.accessor(p["indices"])) // 3 for p in both.mesh["primitives"])


def _hypermask(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hypermask.cli.main", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ,
    )


def test_the_command_writes_the_file(tmp_path: Path) -> None:
    out = tmp_path / "mean.glb"
    done = _hypermask("face", "export", "mean", "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["shapes"] == 52
    assert Reader(out.read_bytes()).names


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("mean", "--out", "face.obj"), "GLTF-NAME"),
        (("mean", "--out", "face.glb", "--shapes", "all"), "GLTF-SHAPES"),
        (("nobody", "--out", "face.glb"), "CHAR-ABSENT"),
    ],
)
def test_a_wrong_command_is_one_line(tmp_path: Path, arguments: tuple[str, ...], code: str) -> None:
    done = _hypermask("face", "export", *arguments)
    assert done.returncode in (1, 2) and "Traceback" not in done.stderr
    assert done.stderr.startswith(f"{code}: ") and len(done.stderr.strip().splitlines()) == 1
