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
struct Sight {
    vec3 foot;
    vec3 towards;
};
const float TOLERANCE = 0.005;
const float STEEPEST = 1.75;
const float NEAR = 1.0;
const float RELAXATION = 0.95;
const int MAX_STEPS = 8192;
const int FALSE_POSITIONS = 6;
const int MAX_ROUNDS = 18;
const float STEEP = 0.8;
const float WIDEST = 2.0;
const float SHORTEST_STEP = 0.5;
const float MISS = -1e30;
const float MAP_RIM = 1.4142135;
const float MAP_MARGIN = 1.686783;
const float MARGIN_SHARE = 0.5;

layout(std140) uniform Picture_block_0Fragment { Picture _group_0_binding_0_fs; };

uniform highp sampler3D _group_0_binding_1_fs;

uniform highp sampler3D _group_0_binding_2_fs;

uniform highp sampler3D _group_0_binding_3_fs;

uniform highp sampler3D _group_0_binding_6_fs;

uniform highp sampler2D _group_0_binding_4_fs;

uniform highp sampler3D _group_0_binding_7_fs;

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

float below(vec3 position_2) {
    float texel_2 = 0.0;
    vec3 _e6 = _group_0_binding_0_fs.field_size;
    vec3 place_1 = ((position_2 + vec3(0.5)) / _e6);
    float _e12 = _group_0_binding_0_fs.smooth_share;
    if ((_e12 < 1.0)) {
        vec4 _e18 = textureLod(_group_0_binding_2_fs, vec3(place_1), 0.0);
        texel_2 = _e18.x;
    }
    float _e22 = _group_0_binding_0_fs.smooth_share;
    if ((_e22 > 0.0)) {
        float _e25 = texel_2;
        vec4 _e29 = textureLod(_group_0_binding_6_fs, vec3(place_1), 0.0);
        float _e33 = _group_0_binding_0_fs.smooth_share;
        texel_2 = mix(_e25, _e29.x, _e33);
    }
    float _e35 = texel_2;
    float _e38 = _group_0_binding_0_fs.depth_scale;
    float _e42 = _group_0_binding_0_fs.depth;
    return ((_e35 * _e38) - _e42);
}

vec4 around(vec3 position_3) {
    vec3 _e6 = _group_0_binding_0_fs.field_size;
    vec3 place_2 = ((position_3 + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_3_fs, vec3(place_2), 0.0);
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
    vec3 place_3 = ((((_e34 > 0u) ? nearest : position_6) + vec3(0.5)) / _e43);
    vec4 _e48 = textureLod(_group_0_binding_7_fs, vec3(place_3), 0.0);
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
    bool local_1 = false;
    mat4x4 _e4 = _group_0_binding_0_fs.volume_from_field;
    float _e11 = _group_0_binding_0_fs.voxel_mm;
    vec3 along_1 = ((_e4 * vec4(inward, 0.0)).xyz / vec3(_e11));
    while(true) {
        float _e22 = _group_0_binding_0_fs.slab_first;
        uint _e23 = index;
        float _e27 = _group_0_binding_0_fs.slab_step;
        float offset_mm = (_e22 + (float(_e23) * _e27));
        vec3 sample_ = (position_5 + (offset_mm * along_1));
        vec2 _e32 = stored_at(sample_);
        bool _e33 = is_in_volume(sample_);
        if (_e33) {
            local_1 = (_e32.y >= 0.5);
        } else {
            local_1 = false;
        }
        bool _e40 = local_1;
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
    vec4 place_4 = vec4(position_in_field_2, 1.0);
    vec4 _e6 = _group_0_binding_0_fs.cuts[0];
    least = dot(_e6, place_4);
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
            least = min(_e14, dot(_e19, place_4));
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

vec3 along(Sight sight, float height_1) {
    return (sight.foot + (height_1 * sight.towards));
}

bool is_map() {
    float _e2 = _group_0_binding_0_fs.map_units_per_pixel;
    return (_e2 > 0.0);
}

vec2 on_disc(vec2 place_in_frame_1) {
    vec2 _e3 = _group_0_binding_0_fs.map_centre;
    vec2 offset = (place_in_frame_1 - _e3);
    float _e11 = _group_0_binding_0_fs.map_units_per_pixel;
    return (vec2(offset.x, -(offset.y)) * _e11);
}

Sight sight_of(vec2 place_in_frame_2) {
    bool _e1 = is_map();
    if (!(_e1)) {
        vec3 _e3 = foot_of(place_in_frame_2);
        vec3 _e6 = _group_0_binding_0_fs.towards_viewer;
        return Sight(_e3, _e6);
    }
    vec2 _e8 = on_disc(place_in_frame_2);
    float squared = dot(_e8, _e8);
    float stretch = sqrt(max((1.0 - (0.25 * squared)), 0.0));
    vec4 direction = vec4((_e8 * stretch), (1.0 - (0.5 * squared)), 0.0);
    vec4 _e27 = _group_0_binding_0_fs.field_from_frame[3];
    mat4x4 _e31 = _group_0_binding_0_fs.field_from_frame;
    return Sight(_e27.xyz, (_e31 * direction).xyz);
}

float share_on_map(vec2 place_in_frame_3) {
    bool _e1 = is_map();
    if (!(_e1)) {
        return 1.0;
    }
    vec2 _e4 = on_disc(place_in_frame_3);
    float radius = length(_e4);
    float _e13 = _group_0_binding_0_fs.map_units_per_pixel;
    vec2 within = clamp((vec2(0.5) + ((vec2(1.4142135, 1.686783) - vec2(radius)) / vec2(_e13))), vec2(0.0), vec2(1.0));
    return (mix(MARGIN_SHARE, 1.0, within.x) * within.y);
}

vec2 reach(Sight sight_1) {
    bool local_2 = false;
    vec3 _e4 = _group_0_binding_0_fs.sphere_centre;
    vec3 from_centre = (sight_1.foot - _e4);
    vec3 aside = (from_centre - (dot(from_centre, sight_1.towards) * sight_1.towards));
    float _e13 = _group_0_binding_0_fs.sphere_radius;
    float _e16 = _group_0_binding_0_fs.sphere_radius;
    float half_squared = ((_e13 * _e16) - dot(aside, aside));
    if (!((half_squared < 0.0))) {
        float _e27 = _group_0_binding_0_fs.sphere_radius;
        local_2 = (_e27 < 0.0);
    } else {
        local_2 = true;
    }
    bool _e31 = local_2;
    if (_e31) {
        return vec2(0.0, -1.0);
    }
    float half_ = sqrt(half_squared);
    float middle = -(dot(from_centre, sight_1.towards));
    vec3 direction_1 = mix(sight_1.towards, vec3(1e-6), lessThan(abs(sight_1.towards), vec3(1e-6)));
    vec3 _e50 = _group_0_binding_0_fs.box_low;
    vec3 low_1 = ((_e50 - sight_1.foot) / direction_1);
    vec3 _e56 = _group_0_binding_0_fs.box_high;
    vec3 high_1 = ((_e56 - sight_1.foot) / direction_1);
    vec3 near = min(low_1, high_1);
    vec3 far = max(low_1, high_1);
    bool _e66 = is_map();
    float end = (_e66 ? max((middle - half_), 0.0) : (middle - half_));
    return vec2(max(max(near.x, near.y), max(near.z, end)), min(min(far.x, far.y), min(far.z, (middle + half_))));
}

float between(Sight sight_2, vec2 above, vec2 under) {
    vec2 high = vec2(0.0);
    vec2 low = vec2(0.0);
    int side = 0;
    int round_ = 0;
    high = above;
    low = under;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            int _e64 = round_;
            round_ = (_e64 + 1);
        }
        loop_init_1 = false;
        int _e9 = round_;
        if ((_e9 < MAX_ROUNDS)) {
        } else {
            break;
        }
        {
            float _e13 = high.y;
            float _e15 = high.y;
            float _e17 = low.y;
            int _e20 = round_;
            float share_1 = ((_e20 < FALSE_POSITIONS) ? (_e13 / (_e15 - _e17)) : 0.5);
            float _e26 = high.x;
            float _e28 = low.x;
            float _e30 = high.x;
            float height_4 = (_e26 + ((_e28 - _e30) * share_1));
            vec3 _e34 = along(sight_2, height_4);
            float _e35 = below(_e34);
            if ((abs(_e35) <= TOLERANCE)) {
                return height_4;
            }
            if ((_e35 < 0.0)) {
                high = vec2(height_4, _e35);
                float _e43 = low.y;
                int _e44 = side;
                low.y = (_e43 * ((_e44 == -1) ? 0.5 : 1.0));
                side = -1;
            } else {
                low = vec2(height_4, _e35);
                float _e54 = high.y;
                int _e55 = side;
                high.y = (_e54 * ((_e55 == 1) ? 0.5 : 1.0));
                side = 1;
            }
        }
    }
    float _e67 = high.x;
    float _e69 = low.x;
    return (0.5 * (_e67 + _e69));
}

vec2 deepest_below(Sight sight_3, float start, float enough) {
    float height_2 = 0.0;
    float deepest = 0.0;
    int steps = 0;
    bool local_3 = false;
    height_2 = start;
    bool loop_init_2 = true;
    while(true) {
        if (!loop_init_2) {
            int _e34 = steps;
            steps = (_e34 + 1);
        }
        loop_init_2 = false;
        int _e8 = steps;
        if ((_e8 < MAX_STEPS)) {
        } else {
            break;
        }
        {
            float _e11 = height_2;
            float _e12 = deepest;
            height_2 = (_e11 - max((1.5 * (enough - _e12)), SHORTEST_STEP));
            float _e19 = height_2;
            vec3 _e20 = along(sight_3, _e19);
            float _e21 = below(_e20);
            float _e22 = deepest;
            deepest = max(_e22, _e21);
            if (!((_e21 < 0.0))) {
                float _e29 = deepest;
                local_3 = (_e29 >= enough);
            } else {
                local_3 = true;
            }
            bool _e32 = local_3;
            if (_e32) {
                break;
            }
        }
    }
    float _e36 = height_2;
    float _e37 = deepest;
    return vec2(_e36, _e37);
}

vec2 first_hit(Sight sight_4) {
    vec2 found = vec2(-1e30, 0.0);
    float height_3 = 0.0;
    float distance_ = 0.0;
    float slope = 1.0;
    int steps_1 = 0;
    float hit = 0.0;
    float step_ = 0.0;
    float ahead = 0.0;
    vec2 _e1 = reach(sight_4);
    vec4 _e5 = _group_0_binding_0_fs.field_from_frame[0];
    float width = min(length(_e5.xyz), WIDEST);
    height_3 = _e1.y;
    float _e16 = height_3;
    vec3 _e17 = along(sight_4, _e16);
    float _e18 = below(_e17);
    distance_ = -(_e18);
    bool loop_init_3 = true;
    while(true) {
        if (!loop_init_3) {
            int _e144 = steps_1;
            steps_1 = (_e144 + 1);
        }
        loop_init_3 = false;
        int _e25 = steps_1;
        if ((_e25 < MAX_STEPS)) {
        } else {
            break;
        }
        {
            float _e28 = height_3;
            if ((_e28 < _e1.x)) {
                break;
            }
            float _e31 = height_3;
            hit = _e31;
            float _e33 = distance_;
            if ((_e33 > TOLERANCE)) {
                float _e36 = distance_;
                float passed = (0.5 - (_e36 / width));
                float _e41 = found.y;
                if ((passed > _e41)) {
                    float _e43 = height_3;
                    found = vec2(_e43, passed);
                }
                float _e45 = distance_;
                float safe = (_e45 / STEEPEST);
                float _e48 = distance_;
                float passing = (1.125 * _e48);
                float _e52 = distance_;
                float _e55 = slope;
                step_ = max(((1.9 * _e52) / (STEEPEST + max(_e55, 0.0))), safe);
                float _e63 = slope;
                if ((passing < (NEAR * _e63))) {
                    float _e66 = slope;
                    step_ = (passing / _e66);
                }
                float _e68 = height_3;
                float _e69 = step_;
                vec3 _e71 = along(sight_4, (_e68 - _e69));
                float _e72 = below(_e71);
                ahead = -(_e72);
                float _e75 = ahead;
                if ((_e75 > 0.0)) {
                    float _e78 = ahead;
                    float _e82 = step_;
                    if (((safe + (_e78 / STEEPEST)) < _e82)) {
                        step_ = safe;
                        float _e84 = height_3;
                        float _e85 = step_;
                        vec3 _e87 = along(sight_4, (_e84 - _e85));
                        float _e88 = below(_e87);
                        ahead = -(_e88);
                    }
                    float _e90 = distance_;
                    float _e91 = ahead;
                    float _e93 = step_;
                    slope = ((_e90 - _e91) / _e93);
                    float _e95 = height_3;
                    float _e96 = step_;
                    height_3 = (_e95 - _e96);
                    float _e98 = ahead;
                    distance_ = _e98;
                    continue;
                }
                float _e99 = height_3;
                float _e100 = distance_;
                float _e103 = height_3;
                float _e104 = step_;
                float _e106 = ahead;
                float _e109 = between(sight_4, vec2(_e99, -(_e100)), vec2((_e103 - _e104), -(_e106)));
                hit = _e109;
            }
            float _e111 = found.y;
            if ((_e111 >= 0.5)) {
                found.y = 1.0;
                break;
            }
            float _e116 = hit;
            found = vec2(_e116, 1.0);
            float _e119 = slope;
            if ((_e119 > STEEP)) {
                break;
            }
            float _e122 = hit;
            vec2 _e125 = deepest_below(sight_4, _e122, (0.5 * width));
            found.y = min((0.5 + (_e125.y / width)), 1.0);
            float _e134 = found.y;
            if ((_e134 >= 1.0)) {
                break;
            }
            height_3 = _e125.x;
            float _e138 = height_3;
            vec3 _e139 = along(sight_4, _e138);
            float _e140 = below(_e139);
            distance_ = -(_e140);
            slope = 0.0;
        }
    }
    vec2 _e146 = found;
    return _e146;
}

vec2 shown_at(vec2 place_in_frame_4, Sight sight_5) {
    float _e2 = share_on_map(place_in_frame_4);
    if ((_e2 <= 0.0)) {
        return vec2(-1e30, 0.0);
    }
    vec2 _e8 = first_hit(sight_5);
    bool _e16 = is_map();
    float share_2 = (_e16 ? ((_e8.y >= 0.5) ? 1.0 : 0.0) : _e8.y);
    return vec2(_e8.x, (share_2 * _e2));
}

void main() {
    OnScreen pixel = OnScreen(gl_FragCoord, _vs2fs_location0);
    Sight _e2 = sight_of(pixel.place_in_frame);
    vec2 _e4 = shown_at(pixel.place_in_frame, _e2);
    if ((_e4.y <= 0.0)) {
        _fs2p_location0 = vec4(0.0);
        return;
    }
    vec3 _e11 = along(_e2, _e4.x);
    vec4 _e13 = shaded(_e11, _e2.towards);
    _fs2p_location0 = (_e13 * _e4.y);
    return;
}

