"""The stage's shaders, GLSL ES 3.00."""

from __future__ import annotations

_HEADER = """#version 300 es
precision highp float;
precision highp sampler2D;
"""

ACTOR_VERTEX = (
    _HEADER
    + """
uniform mat4 clip_from_mask;
in vec4 in_vertex;  // mask metres, and how much light the surface gives back
in vec2 in_uv;
out vec2 uv;
out vec2 on_mask;
out float shade;
void main() {
    uv = in_uv;
    on_mask = in_vertex.xy;
    shade = in_vertex.w;
    gl_Position = clip_from_mask * vec4(in_vertex.xyz, 1.0);
}
"""
)

_ACTOR_FRAGMENT = """
uniform sampler2D skin;    // premultiplied alpha
uniform float light;
uniform vec3 outline;      // 1 / half width, 1 / half height, exponent of the superellipse
uniform float soft_scale;  // 1 / (1 - value of the superellipse where the soft edge begins)
in vec2 uv;
in vec2 on_mask;
in float shade;
out vec4 colour;
void main() {
    vec4 texel = texture(skin, uv);
    DISCARD
    vec2 powers = pow(abs(on_mask) * outline.xy, vec2(outline.z));
    float edge = smoothstep(0.0, 1.0, (1.0 - powers.x - powers.y) * soft_scale);
    colour = vec4(texel.rgb * (light * shade * edge), texel.a);
}
"""

_DISCARD = "if (texel.a < 0.004) discard;"

OPAQUE_FRAGMENT = _HEADER + _ACTOR_FRAGMENT.replace("DISCARD", "")
"""For textures without holes: no discard, so that the GPU may test depth early."""

TRANSPARENT_FRAGMENT = _HEADER + _ACTOR_FRAGMENT.replace("DISCARD", _DISCARD)

_MIX_FRAGMENT = _ACTOR_FRAGMENT.replace(
    "uniform float light;", "uniform sampler2D other;\nuniform vec2 lights;"
).replace(
    "colour = vec4(texel.rgb * (light * shade * edge), texel.a);",
    "vec3 both = texel.rgb * lights.x + texture(other, uv).rgb * lights.y;\n"
    "    colour = vec4(both * (shade * edge), texel.a);",
)

OPAQUE_MIX_FRAGMENT = _HEADER + _MIX_FRAGMENT.replace("DISCARD", "")
"""Two actors that differ by their textures alone, each with its light, as one."""

TRANSPARENT_MIX_FRAGMENT = _HEADER + _MIX_FRAGMENT.replace("DISCARD", _DISCARD)

DISC_VERTEX = (
    _HEADER
    + """
uniform mat4 clip_from_mask;
in vec4 in_vertex;  // mask metres, and blackness
out float blackness;
void main() {
    blackness = in_vertex.w;
    gl_Position = clip_from_mask * vec4(in_vertex.xyz, 1.0);
}
"""
)

DISC_FRAGMENT = (
    _HEADER
    + """
in float blackness;
out vec4 colour;
void main() { colour = vec4(0.0, 0.0, 0.0, blackness); }
"""
)

COMPOSITE_VERTEX = (
    _HEADER
    + """
void main() {  // one triangle over the whole frame; the scissor box says how much of it counts
    gl_Position = vec4(float(gl_VertexID & 1) * 4.0 - 1.0, float(gl_VertexID >> 1) * 4.0 - 1.0,
                       0.0, 1.0);
}
"""
)

COMPOSITE_FRAGMENT = (
    _HEADER
    + """
uniform sampler2D picture;
out vec4 colour;
void main() { colour = vec4(texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb, 0.0); }
"""
)

LENS_VERTEX = (
    _HEADER
    + """
in vec2 in_ndc;    // where the lens needs the light of this corner of the screen
in vec2 in_uv;
in float in_light;
out vec2 uv;
out float light;
void main() {
    uv = in_uv;
    light = in_light;
    gl_Position = vec4(in_ndc, 0.0, 1.0);
}
"""
)

LENS_FRAGMENT = (
    _HEADER
    + """
uniform sampler2D flat_picture;
in vec2 uv;
in float light;
out vec4 colour;
void main() { colour = vec4(texture(flat_picture, uv).rgb * light, 1.0); }
"""
)

OVERLAY_VERTEX = (
    _HEADER
    + """
uniform vec4 box_ndc;  // left, bottom, width, height
out vec2 uv;
void main() {
    vec2 corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1));
    uv = vec2(corner.x, 1.0 - corner.y);
    gl_Position = vec4(box_ndc.xy + corner * box_ndc.zw, 0.0, 1.0);
}
"""
)

TEXT_FRAGMENT = (
    _HEADER
    + """
uniform sampler2D glyphs;
uniform vec3 ink;
in vec2 uv;
out vec4 colour;
void main() { colour = vec4(ink, texture(glyphs, uv).r); }
"""
)

CROSS_FRAGMENT = (
    _HEADER
    + """
uniform vec2 centre;      // window pixels, y up
uniform vec2 half_extent; // half length and half width of an arm, pixels
uniform vec3 ink;
out vec4 colour;
void main() {
    vec2 away = abs(gl_FragCoord.xy - centre);
    vec2 across = clamp(half_extent.y + 0.5 - away, 0.0, 1.0);
    vec2 along = clamp(half_extent.x + 0.5 - away, 0.0, 1.0);
    colour = vec4(ink, max(across.x * along.y, across.y * along.x));
}
"""
)
