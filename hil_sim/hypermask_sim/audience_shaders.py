"""The audience view's shaders, GLSL ES 3.00. Light is linear inside and leaves with gamma 2.

Cheap on a software renderer: cloth is lit per vertex, and the projector's light is looked up only
where it can fall (the mask, and a box around what misses it).
"""

from __future__ import annotations

_HEADER = """#version 300 es
precision highp float;
precision highp sampler2D;
"""

_PROJECTED = """
uniform sampler2D picture;       // the projector's frame, row 0 at the top
uniform vec3 lamp;               // the projector's optical centre in the mask frame
uniform float lamp_gain;         // brightness at 1 m
vec3 projected(vec3 pixel, vec3 on_mask, vec3 normal) {
    vec2 uv = pixel.xy / pixel.z;
    vec2 within = step(abs(uv - 0.5), vec2(0.5));
    vec3 to_lamp = lamp - on_mask;
    float away = inversesqrt(dot(to_lamp, to_lamp));
    float lambert = max(dot(normal, to_lamp) * away, 0.0);
    vec3 light = texture(picture, uv).rgb;
    return light * light * (within.x * within.y * lambert * lamp_gain * away * away);
}
"""

_SHADOW = """
uniform vec3 outline;            // 1 / half width, 1 / half height, exponent
float past_mask(vec3 on_mask) {  // 0 where the mask stops the projector's light
    float depth = max(lamp.z - on_mask.z, lamp.z);
    vec2 crossing = lamp.xy + (on_mask.xy - lamp.xy) * (lamp.z / depth);
    vec2 powers = pow(abs(crossing) * outline.xy, vec2(outline.z));
    return smoothstep(0.98, 1.06, powers.x + powers.y);
}
"""

_STAGE_LIGHT = """
uniform vec3 key;                // direction to the key light, mask frame
uniform vec3 rim;                // direction to the rim light, mask frame
const vec3 AMBIENT = vec3(0.012, 0.014, 0.020);
const vec3 KEY = vec3(0.078, 0.068, 0.056);
const vec3 RIM = vec3(0.16, 0.21, 0.34);
"""

_PLACE = """
uniform mat4 clip_from_mask;
uniform mat4 mask_from_model;
uniform mat4 picture_from_mask;
"""

FACE_VERTEX = (
    _HEADER
    + _PLACE
    + """
invariant gl_Position;           // the depth pass must give the very same depths
in vec3 in_position;
out vec3 on_mask;
out vec3 pixel;
void main() {
    on_mask = in_position;
    pixel = (picture_from_mask * vec4(in_position, 1.0)).xyz;
    gl_Position = clip_from_mask * vec4(in_position, 1.0);
}
"""
)

DEPTH_FRAGMENT = (
    _HEADER
    + """
void main() {}
"""
)

FACE_FRAGMENT = (
    _HEADER
    + _PROJECTED
    + _STAGE_LIGHT
    + """
uniform sampler2D skin;          // normal x, normal y, tone, how far inside the outline
uniform vec2 half_size;
in vec3 on_mask;
in vec3 pixel;
out vec4 colour;
void main() {
    vec4 texel = texture(skin, vec2(on_mask.x, -on_mask.y) / (2.0 * half_size) + 0.5);
    float inside = texel.a - 0.25;
    float edge = clamp(inside / max(fwidth(texel.a), 1e-4) + 0.5, 0.0, 1.0);
    if (edge <= 0.0) discard;
    vec2 tilt = texel.xy * 2.0 - 1.0;
    vec3 n = vec3(tilt, sqrt(max(1.0 - dot(tilt, tilt), 0.01)));
    vec3 light = AMBIENT + KEY * max(dot(n, key), 0.0) + RIM * 0.12 * max(dot(n, rim), 0.0);
    light = light * texel.b + projected(pixel, on_mask, n);
    colour = vec4(sqrt(min(light, vec3(1.0))), edge);
}
"""
)

SCREEN_VERTEX = (
    _HEADER
    + """
uniform mat4 clip_from_mask;
invariant gl_Position;
in vec3 in_position;
in vec3 in_light;                // the picture's place that lights it (u, v), and how brightly
out vec3 on_mask;
out vec3 lit;
void main() {
    on_mask = in_position;
    lit = in_light;
    gl_Position = clip_from_mask * vec4(in_position, 1.0);
}
"""
)

SCREEN_FRAGMENT = (
    _HEADER
    + _STAGE_LIGHT
    + """
uniform sampler2D picture;       // the projector's frame, row 0 at the top
uniform sampler2D skin;
uniform vec2 half_size;
in vec3 on_mask;
in vec3 lit;
out vec4 colour;
void main() {
    vec4 texel = texture(skin, vec2(on_mask.x, -on_mask.y) / (2.0 * half_size) + 0.5);
    float inside = texel.a - 0.25;
    float edge = clamp(inside / max(fwidth(texel.a), 1e-4) + 0.5, 0.0, 1.0);
    if (edge <= 0.0) discard;
    vec2 tilt = texel.xy * 2.0 - 1.0;
    vec3 n = vec3(tilt, sqrt(max(1.0 - dot(tilt, tilt), 0.01)));
    vec3 light = AMBIENT + KEY * max(dot(n, key), 0.0) + RIM * 0.12 * max(dot(n, rim), 0.0);
    vec2 within = step(abs(lit.xy - 0.5), vec2(0.5));
    vec3 through = texture(picture, lit.xy).rgb;
    light = light * 0.5 + through * through * (within.x * within.y * lit.z);
    colour = vec4(sqrt(min(light, vec3(1.0))), edge);
}
"""
)

CLOTH_VERTEX = (
    _HEADER
    + _PLACE
    + _STAGE_LIGHT
    + """
uniform vec3 eye;                // the audience's eye in the mask frame
uniform vec3 albedo;
in vec3 in_position;
in vec3 in_normal;
out vec3 on_mask;
out vec3 normal;
out vec3 pixel;
out vec3 light;
void main() {
    vec4 place = mask_from_model * vec4(in_position, 1.0);
    on_mask = place.xyz;
    normal = mat3(mask_from_model) * in_normal;
    pixel = (picture_from_mask * place).xyz;
    float grazing = 1.0 - abs(dot(normal, normalize(eye - on_mask)));
    float behind = dot(normal, rim);
    light = AMBIENT * 1.5 + KEY * max(dot(normal, key), 0.0);
    light += RIM * (max(behind, 0.0) * 0.2 + max(behind + 0.4, 0.0) * grazing * grazing * grazing);
    light *= albedo;
    gl_Position = clip_from_mask * place;
}
"""
)

CLOTH_FRAGMENT = (
    _HEADER
    + """
in vec3 light;
out vec4 colour;
void main() { colour = vec4(sqrt(light), 1.0); }
"""
)

CLOTH_SPILL_FRAGMENT = (
    _HEADER
    + _PROJECTED
    + _SHADOW
    + """
uniform vec3 albedo;
in vec3 on_mask;
in vec3 normal;
in vec3 pixel;
in vec3 light;
out vec4 colour;
void main() {
    vec3 missed = past_mask(on_mask) * projected(pixel, on_mask, normalize(normal));
    colour = vec4(sqrt(min(light + albedo * missed, vec3(1.0))), 1.0);
}
"""
)

BACKDROP_VERTEX = (
    _HEADER
    + _PLACE
    + """
in vec3 in_position;
in vec2 in_uv;
out vec3 on_mask;
out vec3 pixel;
out vec2 uv;
void main() {
    vec4 place = mask_from_model * vec4(in_position, 1.0);
    on_mask = place.xyz;
    pixel = (picture_from_mask * place).xyz;
    uv = in_uv;
    gl_Position = clip_from_mask * place;
}
"""
)

BACKDROP_FRAGMENT = (
    _HEADER
    + """
uniform sampler2D painting;
in vec2 uv;
out vec4 colour;
void main() { colour = vec4(texture(painting, uv).rgb, 1.0); }
"""
)

BACKDROP_SPILL_FRAGMENT = (
    _HEADER
    + _PROJECTED
    + _SHADOW
    + """
uniform sampler2D painting;
uniform vec3 facing;             // the backdrop's normal in the mask frame
in vec3 on_mask;
in vec3 pixel;
in vec2 uv;
out vec4 colour;
void main() {
    vec3 painted = texture(painting, uv).rgb;
    vec3 missed = past_mask(on_mask) * projected(pixel, on_mask, facing);
    colour = vec4(sqrt(min(painted * painted + missed * vec3(0.16, 0.05, 0.05), vec3(1.0))), 1.0);
}
"""
)
