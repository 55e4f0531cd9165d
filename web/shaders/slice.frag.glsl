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
struct Contours {
    vec4 levels[4];
    uint count;
    float depth_px;
    float px_per_mm;
    float cuts_px;
    uint has_edges;
};
const vec3 EDGE_COLOR = vec3(255.0, 70.0, 200.0);
const float LEAST_RISE = 10.0;
const float FULL_RISE = 20.0;
const float EDGE_HALF_WIDTH = 0.6;
const float RISE_REACH = 0.75;
const vec3 CONTOUR_COLORS[8] = vec3[8](vec3(255.0, 225.0, 60.0), vec3(80.0, 170.0, 255.0), vec3(255.0, 140.0, 40.0), vec3(90.0, 220.0, 110.0), vec3(200.0, 120.0, 255.0), vec3(60.0, 230.0, 230.0), vec3(255.0, 90.0, 90.0), vec3(255.0, 255.0, 255.0));
const float REACH = 1.1;
const float LEAST_SLOPE = 0.2;
const float LEVEL_MARGIN = 0.001;
const float FAR = 3.0;

layout(std140) uniform Picture_block_0Fragment { Picture _group_0_binding_0_fs; };

uniform highp sampler3D _group_0_binding_1_fs;

uniform highp sampler3D _group_0_binding_2_fs;

uniform highp sampler3D _group_0_binding_3_fs;

uniform highp sampler2D _group_0_binding_4_fs;

uniform highp sampler3D _group_0_binding_7_fs;

layout(std140) uniform Contours_block_1Fragment { Contours _group_1_binding_0_fs; };

smooth in vec2 _vs2fs_location0;
layout(location = 0) out vec4 _fs2p_location0;

vec2 defined_part(vec2 texel) {
    return vec2((texel.x / max(texel.y, 1e-6)), texel.y);
}

vec2 stored_at(vec3 position) {
    vec2 texel_1 = vec2(0.0);
    vec3 _e6 = _group_0_binding_0_fs.volume_size;
    vec3 place_4 = ((position + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_1_fs, vec3(place_4), 0.0);
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
    vec3 place_5 = ((position_3 + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_3_fs, vec3(place_5), 0.0);
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
    vec3 nearest_1 = clamp(floor((position_6 + vec3(0.5))), vec3(0.0), (_e27 - vec3(1.0)));
    uint _e34 = _group_0_binding_0_fs.overlay_is_nearest;
    vec3 _e43 = _group_0_binding_0_fs.overlay_size;
    vec3 place_6 = ((((_e34 > 0u) ? nearest_1 : position_6) + vec3(0.5)) / _e43);
    vec4 _e48 = textureLod(_group_0_binding_7_fs, vec3(place_6), 0.0);
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

vec3 under_overlay(vec3 color_1, vec3 position_in_field_1) {
    float _e4 = _group_0_binding_0_fs.overlay_opacity;
    if ((_e4 <= 0.0)) {
        return color_1;
    }
    vec2 _e7 = overlay_at(position_in_field_1);
    float _e10 = overlay_share(_e7.x);
    float share = (_e7.y * _e10);
    uint _e14 = _group_0_binding_0_fs.overlay_color_row;
    float _e16 = overlay_level(_e7.x);
    vec3 _e17 = color_in(_e14, _e16);
    return (color_1 + (share * (_e17 - color_1)));
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
    vec4 place_7 = vec4(position_in_field_2, 1.0);
    vec4 _e6 = _group_0_binding_0_fs.cuts[0];
    least = dot(_e6, place_7);
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
            least = min(_e14, dot(_e19, place_7));
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

vec2 edge_level(vec2 place_in_frame_1) {
    vec3 _e1 = foot_of(place_in_frame_1);
    vec2 _e2 = overlay_at(_e1);
    float _e4 = overlay_level(_e2.x);
    return vec2(_e4, _e2.y);
}

vec3 edge_rise(vec2 place, float reach) {
    vec2 _e5 = edge_level((place + vec2(reach, 0.0)));
    vec2 _e9 = edge_level((place - vec2(reach, 0.0)));
    vec2 _e13 = edge_level((place + vec2(0.0, reach)));
    vec2 _e17 = edge_level((place - vec2(0.0, reach)));
    float defined = min(min(_e5.y, _e9.y), min(_e13.y, _e17.y));
    return vec3((vec2((_e5.x - _e9.x), (_e13.x - _e17.x)) / vec2((2.0 * reach))), defined);
}

vec3 under_edges(vec3 color_2, vec2 place_1) {
    vec4 right = _group_0_binding_0_fs.field_from_frame[0];
    vec4 under = _group_0_binding_0_fs.field_from_frame[1];
    float _e14 = _group_0_binding_0_fs.voxel_mm;
    float mm_per_pixel = (length(right.xyz) * _e14);
    mat4x4 _e18 = _group_0_binding_0_fs.overlay_from_field;
    mat4x4 _e24 = _group_0_binding_0_fs.overlay_from_field;
    float voxels = min(length((_e18 * right).xyz), length((_e24 * under).xyz));
    float reach_1 = max((RISE_REACH / min(mm_per_pixel, voxels)), 1.0);
    vec3 _e34 = edge_rise(place_1, reach_1);
    float here = length(_e34.xy);
    if ((here <= (LEAST_RISE * mm_per_pixel))) {
        return color_2;
    }
    vec2 across = ((_e34.xy / vec2(here)) * reach_1);
    vec3 _e45 = edge_rise((place_1 - across), reach_1);
    float before = length(_e45.xy);
    vec3 _e49 = edge_rise((place_1 + across), reach_1);
    float after = length(_e49.xy);
    float bend = (((2.0 * here) - before) - after);
    if ((bend <= 0.0)) {
        return color_2;
    }
    float distance_ = (abs(((0.5 * (after - before)) / bend)) * reach_1);
    float cover = clamp((1.1 - distance_), 0.0, 1.0);
    float strength = smoothstep(LEAST_RISE, FULL_RISE, (here / mm_per_pixel));
    float share_1 = ((_e34.z > 0.5) ? (cover * strength) : 0.0);
    return mix(color_2, EDGE_COLOR, share_1);
}

float depth_at(vec2 place_in_frame_2) {
    vec3 _e1 = foot_of(place_in_frame_2);
    vec3 _e7 = _group_0_binding_0_fs.field_size;
    vec3 place_8 = ((_e1 + vec3(0.5)) / _e7);
    vec4 _e12 = textureLod(_group_0_binding_2_fs, vec3(place_8), 0.0);
    float _e16 = _group_1_binding_0_fs.depth_px;
    return (_e12.x * _e16);
}

vec3 depths_beside(vec2 place_2) {
    float _e5 = depth_at((place_2 - vec2(1.0, 0.0)));
    float _e6 = depth_at(place_2);
    float _e11 = depth_at((place_2 + vec2(1.0, 0.0)));
    return vec3(_e5, _e6, _e11);
}

vec3 under_contours(vec3 color_3, vec2 place_3) {
    float nearest = FAR;
    uint index_2 = 0u;
    vec3 result = vec3(0.0);
    uint index_3 = 0u;
    bool local_2 = false;
    bool local_3 = false;
    bool local_4 = false;
    float _e2 = depth_at(place_3);
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e28 = index_2;
            index_2 = (_e28 + 1u);
        }
        loop_init_1 = false;
        uint _e7 = index_2;
        uint _e10 = _group_1_binding_0_fs.count;
        if ((_e7 < _e10)) {
        } else {
            break;
        }
        {
            float _e12 = nearest;
            uint _e15 = index_2;
            uint _e19 = index_2;
            float _e23 = _group_1_binding_0_fs.levels[(_e15 / 4u)][(_e19 % 4u)];
            nearest = min(_e12, abs((_e2 - _e23)));
        }
    }
    float _e30 = nearest;
    if ((_e30 >= FAR)) {
        return color_3;
    }
    vec3 _e37 = depths_beside((place_3 - vec2(0.0, 1.0)));
    vec3 _e38 = depths_beside(place_3);
    vec3 _e43 = depths_beside((place_3 + vec2(0.0, 1.0)));
    float slope = max((0.5 * length(vec2((_e38.z - _e38.x), (_e43.y - _e37.y)))), LEAST_SLOPE);
    vec3 lows = min(min(_e37, _e38), _e43);
    vec3 highs = max(max(_e37, _e38), _e43);
    float least_1 = min(min(lows.x, lows.y), lows.z);
    float greatest = max(max(highs.x, highs.y), highs.z);
    vec3 _e70 = foot_of(place_3);
    float _e71 = known_mm(_e70);
    float _e74 = _group_1_binding_0_fs.px_per_mm;
    float _e78 = _group_1_binding_0_fs.cuts_px;
    float known = ((_e71 * _e74) + _e78);
    vec4 _e80 = around(_e70);
    float _e81 = unfenced_of(_e80);
    bool is_unfenced = (_e81 > 0.0);
    result = color_3;
    bool loop_init_2 = true;
    while(true) {
        if (!loop_init_2) {
            uint _e144 = index_3;
            index_3 = (_e144 + 1u);
        }
        loop_init_2 = false;
        uint _e87 = index_3;
        uint _e90 = _group_1_binding_0_fs.count;
        if ((_e87 < _e90)) {
        } else {
            break;
        }
        {
            uint _e94 = index_3;
            uint _e98 = index_3;
            float wanted = _group_1_binding_0_fs.levels[(_e94 / 4u)][(_e98 % 4u)];
            float passed = (wanted - LEVEL_MARGIN);
            float cover_1 = clamp((REACH - (abs((_e2 - wanted)) / slope)), 0.0, 1.0);
            if (is_unfenced) {
                local_2 = (least_1 <= passed);
            } else {
                local_2 = false;
            }
            bool _e117 = local_2;
            if (_e117) {
                local_3 = (passed <= greatest);
            } else {
                local_3 = false;
            }
            bool _e122 = local_3;
            if (_e122) {
                local_4 = ((wanted + REACH) <= known);
            } else {
                local_4 = false;
            }
            bool is_drawn = local_4;
            float share_2 = (is_drawn ? cover_1 : 0.0);
            vec3 _e132 = result;
            uint _e134 = index_3;
            result = floor((mix(_e132, CONTOUR_COLORS[(_e134 % 8u)], share_2) + vec3(0.5)));
        }
    }
    vec3 _e146 = result;
    return _e146;
}

void main() {
    OnScreen pixel = OnScreen(gl_FragCoord, _vs2fs_location0);
    bool local = false;
    vec3 color = vec3(0.0);
    vec3 _e2 = foot_of(pixel.place_in_frame);
    mat4x4 _e5 = _group_0_binding_0_fs.volume_from_field;
    vec3 position_8 = (_e5 * vec4(_e2, 1.0)).xyz;
    vec2 _e10 = stored_at(position_8);
    bool _e11 = is_in_volume(position_8);
    if (_e11) {
        local = (_e10.y >= 0.5);
    } else {
        local = false;
    }
    bool is_there_1 = local;
    uint _e23 = _group_0_binding_0_fs.color_row;
    float _e25 = brightness(_e10.x);
    vec3 _e26 = color_in(_e23, _e25);
    vec3 shown = (is_there_1 ? _e26 : vec3(0.0));
    color = shown;
    uint _e31 = _group_1_binding_0_fs.has_edges;
    if ((_e31 > 0u)) {
        vec3 _e35 = under_edges(shown, pixel.place_in_frame);
        color = _e35;
    } else {
        vec3 _e36 = under_overlay(shown, _e2);
        color = _e36;
    }
    vec3 _e37 = color;
    color = floor((_e37 + vec3(0.5)));
    vec3 _e42 = color;
    vec3 _e44 = under_contours(_e42, pixel.place_in_frame);
    _fs2p_location0 = vec4((_e44 / vec3(255.0)), 1.0);
    return;
}

