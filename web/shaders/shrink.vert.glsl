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
struct Paths {
    vec3 origin_in_patient;
    float step_mm;
    float depth_mm;
    float row_mm;
    uint row;
    uint vertex_count;
    uint first_piece;
    uint piece_count;
};
struct Shrunk {
    vec4 nowhere;
    vec3 position_in_patient;
};
const uint PIECE_WORDS = 6u;
const int MOVES = 4;
const float FARTHEST = 1.0;

layout(std140) uniform Picture_block_0Vertex { Picture _group_0_binding_0_vs; };

uniform highp sampler3D _group_0_binding_2_vs;

uniform highp sampler3D _group_0_binding_3_vs;

uniform highp sampler3D _group_0_binding_6_vs;

layout(std140) uniform Paths_block_1Vertex { Paths _group_1_binding_0_vs; };

uniform highp usampler2D _group_1_binding_1_vs;

uniform highp usampler2D _group_1_binding_2_vs;

smooth out vec3 _vs2fs_location0;

vec2 defined_part(vec2 texel) {
    return vec2((texel.x / max(texel.y, 1e-6)), texel.y);
}

bool is_in_volume(vec3 position_1) {
    vec3 _e5 = _group_0_binding_0_vs.volume_size;
    return all(equal(clamp(position_1, vec3(-0.5), (_e5 - vec3(0.5))), position_1));
}

float below(vec3 position_2) {
    float texel_2 = 0.0;
    vec3 _e6 = _group_0_binding_0_vs.field_size;
    vec3 place_1 = ((position_2 + vec3(0.5)) / _e6);
    float _e12 = _group_0_binding_0_vs.smooth_share;
    if ((_e12 < 1.0)) {
        vec4 _e18 = textureLod(_group_0_binding_2_vs, vec3(place_1), 0.0);
        texel_2 = _e18.x;
    }
    float _e22 = _group_0_binding_0_vs.smooth_share;
    if ((_e22 > 0.0)) {
        float _e25 = texel_2;
        vec4 _e29 = textureLod(_group_0_binding_6_vs, vec3(place_1), 0.0);
        float _e33 = _group_0_binding_0_vs.smooth_share;
        texel_2 = mix(_e25, _e29.x, _e33);
    }
    float _e35 = texel_2;
    float _e38 = _group_0_binding_0_vs.depth_scale;
    float _e42 = _group_0_binding_0_vs.depth;
    return ((_e35 * _e38) - _e42);
}

vec3 inward_at(vec3 position_3) {
    vec3 _e6 = _group_0_binding_0_vs.field_size;
    vec3 place_2 = ((position_3 + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_3_vs, vec3(place_2), 0.0);
    vec3 gradient = _e11.xyz;
    return (gradient / vec3(max(length(gradient), 1e-6)));
}

vec3 stored_position(uint index) {
    uint width = uvec2(textureSize(_group_1_binding_1_vs, 0).xy).x;
    ivec2 texel_3 = ivec2(int((index % width)), int((index / width)));
    uvec4 _e11 = texelFetch(_group_1_binding_1_vs, texel_3, 0);
    return vec3(_e11.xyz);
}

uint piece_word(uint index_1) {
    uint width_1 = uvec2(textureSize(_group_1_binding_2_vs, 0).xy).x;
    ivec2 texel_4 = ivec2(int((index_1 % width_1)), int((index_1 / width_1)));
    uvec4 _e11 = texelFetch(_group_1_binding_2_vs, texel_4, 0);
    return _e11.x;
}

float low_half(uint word) {
    return float((word & 65535u));
}

float high_half(uint word_1) {
    return float((word_1 >> 16u));
}

vec3 on_piece(uint start, vec2 depths_mm) {
    uint _e4 = piece_word((start + 3u));
    uint _e7 = piece_word((start + 4u));
    uint _e10 = piece_word((start + 5u));
    float _e11 = low_half(_e4);
    float _e12 = high_half(_e4);
    float _e13 = low_half(_e7);
    vec3 near = vec3(_e11, _e12, _e13);
    float _e15 = high_half(_e7);
    float _e16 = low_half(_e10);
    float _e17 = high_half(_e10);
    vec3 far = vec3(_e15, _e16, _e17);
    float _e21 = _group_1_binding_0_vs.depth_mm;
    return mix(near, far, ((_e21 - depths_mm.x) / (depths_mm.y - depths_mm.x)));
}

uint first_piece_of(uint vertex_1) {
    uint low = 0u;
    uint high = 0u;
    uint _e3 = _group_1_binding_0_vs.first_piece;
    low = _e3;
    uint _e7 = _group_1_binding_0_vs.first_piece;
    uint _e10 = _group_1_binding_0_vs.piece_count;
    high = (_e7 + _e10);
    while(true) {
        uint _e13 = low;
        uint _e14 = high;
        if ((_e13 < _e14)) {
        } else {
            break;
        }
        {
            uint _e16 = low;
            uint _e17 = high;
            uint middle = ((_e16 + _e17) / 2u);
            uint _e23 = piece_word((middle * PIECE_WORDS));
            if ((_e23 < vertex_1)) {
                low = (middle + 1u);
            } else {
                high = middle;
            }
        }
    }
    uint _e27 = low;
    return _e27;
}

vec3 shrunk(uint vertex_2) {
    vec3 position_4 = vec3(0.0);
    uint piece = 0u;
    bool local = false;
    uint _e3 = _group_1_binding_0_vs.row;
    uint _e6 = _group_1_binding_0_vs.vertex_count;
    uint index_2 = ((_e3 * _e6) + vertex_2);
    float _e11 = _group_1_binding_0_vs.depth_mm;
    uint _e14 = _group_1_binding_0_vs.row;
    float _e18 = _group_1_binding_0_vs.row_mm;
    float _e23 = _group_1_binding_0_vs.row_mm;
    float fraction = ((_e11 - (float(_e14) * _e18)) / _e23);
    vec3 _e25 = stored_position(index_2);
    uint _e28 = _group_1_binding_0_vs.vertex_count;
    vec3 _e30 = stored_position((index_2 + _e28));
    position_4 = mix(_e25, _e30, fraction);
    uint _e35 = _group_1_binding_0_vs.first_piece;
    uint _e38 = _group_1_binding_0_vs.piece_count;
    uint end = (_e35 + _e38);
    uint _e40 = first_piece_of(vertex_2);
    piece = _e40;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e74 = piece;
            piece = (_e74 + 1u);
        }
        loop_init = false;
        uint _e42 = piece;
        if ((_e42 < end)) {
        } else {
            break;
        }
        {
            uint _e44 = piece;
            uint start_1 = (_e44 * PIECE_WORDS);
            uint _e47 = piece_word(start_1);
            if ((_e47 != vertex_2)) {
                break;
            }
            uint _e51 = piece_word((start_1 + 1u));
            uint _e55 = piece_word((start_1 + 2u));
            vec2 depths_mm_1 = vec2(uintBitsToFloat(_e51), uintBitsToFloat(_e55));
            float _e61 = _group_1_binding_0_vs.depth_mm;
            if ((depths_mm_1.x < _e61)) {
                float _e67 = _group_1_binding_0_vs.depth_mm;
                local = (_e67 <= depths_mm_1.y);
            } else {
                local = false;
            }
            bool _e71 = local;
            if (_e71) {
                vec3 _e72 = on_piece(start_1, depths_mm_1);
                position_4 = _e72;
            }
        }
    }
    vec3 _e76 = position_4;
    return _e76;
}

vec3 settled(vec3 position_in_patient) {
    vec3 place = vec3(0.0);
    int move = 0;
    float _e3 = _group_0_binding_0_vs.smooth_share;
    if ((_e3 == 0.0)) {
        return position_in_patient;
    }
    mat4x4 _e8 = _group_0_binding_0_vs.field_from_patient;
    vec3 start_2 = (_e8 * vec4(position_in_patient, 1.0)).xyz;
    place = start_2;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            int _e30 = move;
            move = (_e30 + 1);
        }
        loop_init_1 = false;
        int _e16 = move;
        if ((_e16 < MOVES)) {
        } else {
            break;
        }
        {
            vec3 _e19 = place;
            vec3 _e20 = place;
            vec3 _e21 = inward_at(_e20);
            vec3 _e22 = place;
            float _e23 = below(_e22);
            place = (_e19 - (_e21 * clamp(_e23, -1.0, FARTHEST)));
        }
    }
    float _e34 = _group_0_binding_0_vs.voxel_mm;
    vec3 _e35 = place;
    return (position_in_patient + (_e34 * (_e35 - start_2)));
}

vec3 shrunk_position(uint vertex_3) {
    vec3 _e3 = _group_1_binding_0_vs.origin_in_patient;
    float _e6 = _group_1_binding_0_vs.step_mm;
    vec3 _e7 = shrunk(vertex_3);
    vec3 _e10 = settled((_e3 + (_e6 * _e7)));
    return _e10;
}

void main() {
    uint vertex = uint(gl_VertexID);
    vec3 _e3 = shrunk_position(vertex);
    Shrunk _tmp_return = Shrunk(vec4(0.0), _e3);
    gl_Position = _tmp_return.nowhere;
    _vs2fs_location0 = _tmp_return.position_in_patient;
    return;
}

