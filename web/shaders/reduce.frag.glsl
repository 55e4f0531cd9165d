#version 300 es

precision highp float;
precision highp int;

struct Picture {
    mat4x4 field_from_frame;
    mat4x4 volume_from_field;
    mat4x4 field_from_patient;
    mat4x4 clip_from_patient;
    vec3 volume_size;
    float stored_scale;
    vec3 field_size;
    float stored_offset;
    vec3 towards_viewer;
    float depth_scale;
    vec3 box_low;
    float depth;
    vec3 box_high;
    float voxel_mm;
    vec3 sphere_centre;
    float sphere_radius;
    vec2 size;
    float ambient;
    uint color_row;
    float window_black;
    float window_factor;
    float window_offset;
    uint slab_count;
    float slab_first;
    float slab_step;
    float clip_reach;
    float clip_piece;
    float smooth_share;
    uint window_is_sigmoid;
    vec4 cuts[6];
    mat4x4 overlay_from_field;
    vec3 overlay_size;
    float overlay_scale;
    float overlay_offset;
    float overlay_low;
    float overlay_factor;
    float overlay_threshold;
    float overlay_steepness;
    float overlay_opacity;
    uint overlay_color_row;
    uint overlay_is_diverging;
    uint volume_has_gaps;
    uint overlay_is_nearest;
    vec2 map_centre;
    float map_units_per_pixel;
};
struct OnScreen {
    vec4 position;
    vec2 place_in_frame;
};
layout(std140) uniform Picture_block_0Fragment { Picture _group_0_binding_0_fs; };

uniform highp sampler3D _group_0_binding_1_fs;

uniform highp sampler3D _group_0_binding_3_fs;

uniform highp sampler2D _group_0_binding_4_fs;

uniform highp sampler3D _group_0_binding_7_fs;

uniform highp sampler2D _group_1_binding_3_fs;

smooth in vec2 _vs2fs_location0;
layout(location = 0) out vec4 _fs2p_location0;

vec2 defined_part(vec2 texel) {
    return vec2((texel.x / max(texel.y, 1e-6)), texel.y);
}

vec2 stored_at(vec3 position) {
    vec2 texel_1 = vec2(0.0);
    vec3 _e6 = _group_0_binding_0_fs.volume_size;
    vec3 place = ((position + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_1_fs, vec3(place), 0.0);
    texel_1 = _e11.xy;
    uint _e16 = _group_0_binding_0_fs.volume_has_gaps;
    if ((_e16 == 0u)) {
        texel_1.y = 1.0;
    }
    vec2 _e21 = texel_1;
    vec2 _e22 = defined_part(_e21);
    float _e26 = _group_0_binding_0_fs.stored_scale;
    float _e30 = _group_0_binding_0_fs.stored_offset;
    return vec2(((_e22.x * _e26) + _e30), _e22.y);
}

bool is_in_volume(vec3 position_1) {
    vec3 _e5 = _group_0_binding_0_fs.volume_size;
    return all(equal(clamp(position_1, vec3(-0.5), (_e5 - vec3(0.5))), position_1));
}

vec4 around(vec3 position_3) {
    vec3 _e6 = _group_0_binding_0_fs.field_size;
    vec3 place_1 = ((position_3 + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_3_fs, vec3(place_1), 0.0);
    return _e11;
}

vec3 inward_of(vec4 around_1) {
    vec3 gradient = around_1.xyz;
    return (gradient / vec3(max(length(gradient), 1e-6)));
}

float unfenced_of(vec4 around_2) {
    return ((around_2.w < 0.5) ? 1.0 : 0.0);
}

vec3 inward_at(vec3 position_4) {
    vec4 _e1 = around(position_4);
    vec3 _e2 = inward_of(_e1);
    return _e2;
}

float brightness(float stored) {
    float _e3 = _group_0_binding_0_fs.window_black;
    float _e7 = _group_0_binding_0_fs.window_factor;
    float _e11 = _group_0_binding_0_fs.window_offset;
    float ramp = (((stored - _e3) * _e7) + _e11);
    uint _e15 = _group_0_binding_0_fs.window_is_sigmoid;
    if ((_e15 == 1u)) {
        return (255.0 / (1.0 + exp(-(ramp))));
    }
    return clamp(ramp, 0.0, 255.0);
}

vec3 color_in(uint row, float level) {
    ivec2 texel_3 = ivec2(int((level + 0.5)), int(row));
    vec4 _e9 = texelFetch(_group_0_binding_4_fs, texel_3, 0);
    return (_e9.xyz * 255.0);
}

float overlay_share(float value) {
    uint _e4 = _group_0_binding_0_fs.overlay_is_diverging;
    float size = ((_e4 > 0u) ? abs(value) : value);
    float _e10 = _group_0_binding_0_fs.overlay_threshold;
    float _e14 = _group_0_binding_0_fs.overlay_steepness;
    float rise = clamp(((size - _e10) * _e14), 0.0, 1.0);
    float _e21 = _group_0_binding_0_fs.overlay_opacity;
    return (_e21 * ((rise * rise) * (3.0 - (2.0 * rise))));
}

vec2 overlay_at(vec3 position_in_field) {
    mat4x4 _e3 = _group_0_binding_0_fs.overlay_from_field;
    vec3 position_6 = (_e3 * vec4(position_in_field, 1.0)).xyz;
    vec3 _e12 = _group_0_binding_0_fs.overlay_size;
    bool is_inside = all(equal(clamp(position_6, vec3(-0.5), (_e12 - vec3(0.5))), position_6));
    vec3 _e27 = _group_0_binding_0_fs.overlay_size;
    vec3 nearest = clamp(floor((position_6 + vec3(0.5))), vec3(0.0), (_e27 - vec3(1.0)));
    uint _e34 = _group_0_binding_0_fs.overlay_is_nearest;
    vec3 _e43 = _group_0_binding_0_fs.overlay_size;
    vec3 place_2 = ((((_e34 > 0u) ? nearest : position_6) + vec3(0.5)) / _e43);
    vec4 _e48 = textureLod(_group_0_binding_7_fs, vec3(place_2), 0.0);
    vec2 _e50 = defined_part(_e48.xy);
    float _e54 = _group_0_binding_0_fs.overlay_scale;
    float _e58 = _group_0_binding_0_fs.overlay_offset;
    return vec2(((_e50.x * _e54) + _e58), (is_inside ? _e50.y : 0.0));
}

float overlay_level(float value_1) {
    float _e3 = _group_0_binding_0_fs.overlay_low;
    float _e7 = _group_0_binding_0_fs.overlay_factor;
    return clamp(((value_1 - _e3) * _e7), 0.0, 255.0);
}

vec3 under_overlay(vec3 color, vec3 position_in_field_1) {
    float _e4 = _group_0_binding_0_fs.overlay_opacity;
    if ((_e4 <= 0.0)) {
        return color;
    }
    vec2 _e7 = overlay_at(position_in_field_1);
    float _e10 = overlay_share(_e7.x);
    float share = (_e7.y * _e10);
    uint _e14 = _group_0_binding_0_fs.overlay_color_row;
    float _e16 = overlay_level(_e7.x);
    vec3 _e17 = color_in(_e14, _e16);
    return (color + (share * (_e17 - color)));
}

float light_on(float facing) {
    float _e3 = _group_0_binding_0_fs.ambient;
    float _e6 = _group_0_binding_0_fs.ambient;
    return (_e3 + ((1.0 - _e6) * clamp(facing, 0.0, 1.0)));
}

vec2 stored_on(vec3 position_5, vec3 inward) {
    float sum = 0.0;
    float count = 0.0;
    uint index = 0u;
    bool local = false;
    mat4x4 _e4 = _group_0_binding_0_fs.volume_from_field;
    float _e11 = _group_0_binding_0_fs.voxel_mm;
    vec3 along = ((_e4 * vec4(inward, 0.0)).xyz / vec3(_e11));
    while(true) {
        float _e22 = _group_0_binding_0_fs.slab_first;
        uint _e23 = index;
        float _e27 = _group_0_binding_0_fs.slab_step;
        float offset_mm = (_e22 + (float(_e23) * _e27));
        vec3 sample_ = (position_5 + (offset_mm * along));
        vec2 _e32 = stored_at(sample_);
        bool _e33 = is_in_volume(sample_);
        if (_e33) {
            local = (_e32.y >= 0.5);
        } else {
            local = false;
        }
        bool _e40 = local;
        float is_there = (_e40 ? 1.0 : 0.0);
        float _e44 = sum;
        sum = (_e44 + (is_there * _e32.x));
        float _e48 = count;
        count = (_e48 + is_there);
        uint _e51 = index;
        index = (_e51 + 1u);
        uint _e53 = index;
        uint _e56 = _group_0_binding_0_fs.slab_count;
        if ((_e53 >= _e56)) {
            break;
        }
    }
    float _e58 = sum;
    float _e59 = count;
    float _e63 = count;
    return vec2((_e58 / max(_e59, 1.0)), min(_e63, 1.0));
}

float known_mm(vec3 position_in_field_2) {
    float least = 0.0;
    int index_1 = 1;
    vec4 place_3 = vec4(position_in_field_2, 1.0);
    vec4 _e6 = _group_0_binding_0_fs.cuts[0];
    least = dot(_e6, place_3);
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            int _e23 = index_1;
            index_1 = (_e23 + 1);
        }
        loop_init = false;
        int _e11 = index_1;
        if ((_e11 < 6)) {
        } else {
            break;
        }
        {
            float _e14 = least;
            int _e17 = index_1;
            vec4 _e19 = _group_0_binding_0_fs.cuts[_e17];
            least = min(_e14, dot(_e19, place_3));
        }
    }
    float _e25 = least;
    return _e25;
}

float known_at(vec3 position_in_field_3, vec4 around_3) {
    float _e2 = known_mm(position_in_field_3);
    float _e8 = unfenced_of(around_3);
    return (((_e2 >= 0.0) ? 1.0 : 0.0) * _e8);
}

vec4 shaded(vec3 position_in_field_4, vec3 towards) {
    vec4 _e2 = around(position_in_field_4);
    vec3 _e3 = inward_of(_e2);
    mat4x4 _e6 = _group_0_binding_0_fs.volume_from_field;
    vec3 position_7 = (_e6 * vec4(position_in_field_4, 1.0)).xyz;
    vec2 _e11 = stored_on(position_7, _e3);
    float facing_1 = -(dot(_e3, towards));
    uint _e16 = _group_0_binding_0_fs.color_row;
    float _e18 = brightness(_e11.x);
    vec3 _e19 = color_in(_e16, _e18);
    vec3 _e20 = under_overlay(_e19, position_in_field_4);
    float _e21 = light_on(facing_1);
    vec3 lit = (_e20 * _e21);
    float _e34 = known_at(position_in_field_4, _e2);
    return ((vec4((floor((lit + vec3(0.5))) / vec3(255.0)), 1.0) * _e11.y) * _e34);
}

vec3 foot_of(vec2 place_in_frame) {
    mat4x4 _e3 = _group_0_binding_0_fs.field_from_frame;
    return (_e3 * vec4(place_in_frame, 0.0, 1.0)).xyz;
}

vec3 at_height(vec3 foot, float height) {
    vec3 _e4 = _group_0_binding_0_fs.towards_viewer;
    return (foot + (height * _e4));
}

float height_of(float depth) {
    float _e7 = _group_0_binding_0_fs.clip_reach;
    return ((1.0 - (2.0 * depth)) * _e7);
}

vec4 resolved(vec2 place_in_frame_1, vec4 samples) {
    float nearest_1 = min(min(samples.x, samples.y), min(samples.z, samples.w));
    if ((nearest_1 >= 1.0)) {
        return vec4(0.0);
    }
    float _e19 = _group_0_binding_0_fs.clip_piece;
    vec4 is_near = mix(vec4(0.0), vec4(1.0), lessThanEqual(samples, vec4((nearest_1 + _e19))));
    float _e29 = height_of((dot(samples, is_near) / dot(is_near, vec4(1.0))));
    float coverage = dot(mix(vec4(0.0), vec4(0.25), lessThan(samples, vec4(1.0))), vec4(1.0));
    vec3 _e41 = foot_of(place_in_frame_1);
    vec3 _e42 = at_height(_e41, _e29);
    vec3 _e45 = _group_0_binding_0_fs.towards_viewer;
    vec4 _e46 = shaded(_e42, _e45);
    return (_e46 * coverage);
}

void main() {
    OnScreen pixel = OnScreen(gl_FragCoord, _vs2fs_location0);
    vec2 _e6 = _group_0_binding_0_fs.size;
    ivec2 side = (ivec2(uvec2(textureSize(_group_1_binding_3_fs, 0).xy)) / ivec2(_e6));
    ivec2 place_4 = ivec2(pixel.place_in_frame);
    float _e15 = _group_0_binding_0_fs.size.y;
    ivec2 low = (ivec2(place_4.x, ((int(_e15) - 1) - place_4.y)) * side);
    ivec2 high = ((low + side) - ivec2(1));
    vec4 _e30 = texelFetch(_group_1_binding_3_fs, low, 0);
    vec4 _e37 = texelFetch(_group_1_binding_3_fs, ivec2(high.x, low.y), 0);
    vec4 _e44 = texelFetch(_group_1_binding_3_fs, ivec2(low.x, high.y), 0);
    vec4 _e48 = texelFetch(_group_1_binding_3_fs, high, 0);
    vec4 _e51 = resolved(pixel.place_in_frame, vec4(_e30.x, _e37.x, _e44.x, _e48.x));
    _fs2p_location0 = _e51;
    return;
}

