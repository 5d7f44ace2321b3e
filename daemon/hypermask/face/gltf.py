"""A character as glTF 2.0 (.glb): meshes, textures and blendshapes, for games and other tools.

Metres, y up, the face looks along +z. One node with one mesh, whose primitives are the eyes, the
bag of the mouth, the teeth, the skin and the tongue; all have the same morph targets, named in
`mesh.extras.targetNames`. Textures are sRGB and embedded.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.character import Character
from hypermask.face.face import Face
from hypermask.face.gltf_binary import Buffer, container
from hypermask.face.gltf_shapes import Shapes, emotion_clips, targets
from hypermask.face.gltf_solid import Part, Solid, normals
from hypermask.mask import Mask

Array = NDArray[np.float64]

_LEAST_M = 2e-6
_LEAST_TURN = 2e-3
_JPEG_QUALITY = 95
_REPEAT_NEVER, _LINEAR, _MIPMAPS = 33071, 9729, 9987
_CLIP_S = (0.0, 0.4, 1.4, 2.0)
_CLIP = (0.0, 1.0, 1.0, 0.0)
_ROUGHNESS = {"skin": 0.75, "eyes": 0.25, "lower_teeth": 0.35, "upper_teeth": 0.35}


def export_glb(character: Character, mask: Mask, shapes: Shapes = "arkit") -> bytes:
    """The file's bytes. shapes: "arkit" (52), "units" (44 action units, 5 visemes) or "both".

    With units there are six clips as well, one an emotion. Raises `UsageError` GLTF-SHAPES.
    """
    chosen = targets(shapes)
    solid, buffer = Solid(Face(character, mask)), Buffer()
    rest = solid.places()
    offsets = [solid.offsets(target, rest) for target in chosen]
    primitives = [
        _primitive(buffer, part, number, places, [moved[number] for moved in offsets])
        for number, (part, places) in enumerate(zip(solid.parts, rest, strict=True))
    ]
    mesh = {
        "name": character.name,
        "primitives": primitives,
        "weights": [0.0] * len(chosen),
        "extras": {"targetNames": [target.name for target in chosen]},
    }
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "HYPERMASK"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": character.name, "mesh": 0}],
        "meshes": [mesh],
        **_surfaces(buffer, solid.parts),
    }
    clips = _clips(buffer, emotion_clips(shapes))
    return container({**document, "animations": clips} if clips else document, buffer)


def _primitive(
    buffer: Buffer, part: Part, material: int, places: Array, offsets: list[Array]
) -> dict[str, Any]:
    ahead = normals(places, part.triangles)
    attributes = {
        "POSITION": buffer.vectors(places, bounds=True),
        "NORMAL": buffer.vectors(ahead),
        "TEXCOORD_0": buffer.vectors(part.layer.uv[part.used]),
    }
    morphs = []
    for offset in offsets:
        turned = normals(places + offset, part.triangles) - ahead
        turned[~_near_moved(part, offset)] = 0
        morphs.append(
            {
                "POSITION": buffer.offsets(offset, _LEAST_M, bounds=True),
                "NORMAL": buffer.offsets(turned, _LEAST_TURN),
            }
        )
    return {
        "attributes": attributes,
        "indices": buffer.indices(part.triangles),
        "material": material,
        "targets": morphs,
    }


def _near_moved(part: Part, offset: Array) -> NDArray[np.bool_]:
    """Vertices of triangles of which a corner moves: only their normals can turn."""
    moves = (np.abs(offset) >= _LEAST_M).any(axis=1)
    near = np.zeros(len(offset), bool)
    near[part.triangles[np.asarray(moves)[part.triangles].any(axis=1)]] = True
    return near


def _surfaces(buffer: Buffer, parts: tuple[Part, ...]) -> dict[str, Any]:
    """Materials, textures, images and the sampler, one each for every part."""
    images, materials = [], []
    for number, part in enumerate(parts):
        picture = part.layer.texture
        clear = bool((picture[..., 3] < 255).any())
        kind, data = _encoded(picture, clear, part.layer.name == "skin")
        images.append({"bufferView": buffer.view(data), "mimeType": kind, "name": part.layer.name})
        material: dict[str, Any] = {
            "name": part.layer.name,
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": number},
                "metallicFactor": 0.0,
                "roughnessFactor": _ROUGHNESS.get(part.layer.name, 0.9),
            },
        }
        if clear:
            material |= {"alphaMode": "MASK", "alphaCutoff": 0.5}
        materials.append(material)
    sampler = {
        "magFilter": _LINEAR,
        "minFilter": _MIPMAPS,
        "wrapS": _REPEAT_NEVER,
        "wrapT": _REPEAT_NEVER,
    }
    textures = [{"sampler": 0, "source": number} for number in range(len(images))]
    return {"materials": materials, "textures": textures, "images": images, "samplers": [sampler]}


def _encoded(picture: NDArray[np.uint8], clear: bool, photographic: bool) -> tuple[str, bytes]:
    """(MIME type, bytes): JPEG for the skin, PNG for small painted pictures and clear ones."""
    if photographic and not clear:
        quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        return "image/jpeg", cv2.imencode(".jpg", picture[..., 2::-1], quality)[1].tobytes()
    order = [2, 1, 0, 3] if clear else [2, 1, 0]
    return "image/png", cv2.imencode(".png", picture[..., order])[1].tobytes()


def _clips(buffer: Buffer, emotions: dict[str, Array]) -> list[dict[str, Any]]:
    """An animation an emotion: it comes, stays a second and goes."""
    if not emotions:
        return []
    times = buffer.numbers(np.array(_CLIP_S), bounds=True)
    clips = []
    for name, weights in emotions.items():
        output = buffer.numbers(np.outer(_CLIP, weights).reshape(-1))
        clips.append(
            {
                "name": name,
                "samplers": [{"input": times, "output": output, "interpolation": "LINEAR"}],
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
            }
        )
    return clips
