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
};
struct OnFacet {
    vec4 position;
    vec3 position_in_field;
};
layout(std140) uniform Picture_block_0Fragment { Picture _group_0_binding_0_fs; };

uniform highp sampler3D _group_0_binding_1_fs;

uniform highp sampler3D _group_0_binding_3_fs;

uniform highp sampler2D _group_0_binding_4_fs;

smooth centroid in vec3 _vs2fs_location0;
layout(location = 0) out vec4 _fs2p_location0;

float stored_at(vec3 position) {
    vec3 _e6 = _group_0_binding_0_fs.volume_size;
    vec3 place = ((position + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_1_fs, vec3(place), 0.0);
    float _e15 = _group_0_binding_0_fs.stored_scale;
    float _e19 = _group_0_binding_0_fs.stored_offset;
    return ((_e11.x * _e15) + _e19);
}

bool is_in_volume(vec3 position_1) {
    bool local = false;
    if (all(greaterThanEqual(position_1, vec3(-0.5)))) {
        vec3 _e9 = _group_0_binding_0_fs.volume_size;
        local = all(lessThanEqual(position_1, (_e9 - vec3(0.5))));
    } else {
        local = false;
    }
    bool _e16 = local;
    return _e16;
}

vec3 inward_at(vec3 position_3) {
    vec3 _e6 = _group_0_binding_0_fs.field_size;
    vec3 place_1 = ((position_3 + vec3(0.5)) / _e6);
    vec4 _e11 = textureLod(_group_0_binding_3_fs, vec3(place_1), 0.0);
    vec3 gradient = _e11.xyz;
    return (gradient / vec3(max(length(gradient), 1e-6)));
}

float brightness(float stored) {
    float _e3 = _group_0_binding_0_fs.window_black;
    float _e7 = _group_0_binding_0_fs.window_factor;
    float _e11 = _group_0_binding_0_fs.window_offset;
    float ramp = (((stored - _e3) * _e7) + _e11);
    return clamp(ramp, 0.0, 255.0);
}

vec3 color_of(float level) {
    uint _e6 = _group_0_binding_0_fs.color_row;
    ivec2 texel_1 = ivec2(int((level + 0.5)), int(_e6));
    vec4 _e11 = texelFetch(_group_0_binding_4_fs, texel_1, 0);
    return (_e11.xyz * 255.0);
}

float light_on(float facing) {
    float _e3 = _group_0_binding_0_fs.ambient;
    float _e6 = _group_0_binding_0_fs.ambient;
    return (_e3 + ((1.0 - _e6) * clamp(facing, 0.0, 1.0)));
}

vec2 slab_mean(vec3 position_4, vec3 inward) {
    float sum = 0.0;
    float count = 0.0;
    uint index = 0u;
    mat4x4 _e4 = _group_0_binding_0_fs.volume_from_field;
    float _e11 = _group_0_binding_0_fs.voxel_mm;
    vec3 along = ((_e4 * vec4(inward, 0.0)).xyz / vec3(_e11));
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e45 = index;
            index = (_e45 + 1u);
        }
        loop_init = false;
        uint _e20 = index;
        uint _e23 = _group_0_binding_0_fs.slab_count;
        if ((_e20 < _e23)) {
        } else {
            break;
        }
        {
            float _e27 = _group_0_binding_0_fs.slab_first;
            uint _e28 = index;
            float _e32 = _group_0_binding_0_fs.slab_step;
            float offset_mm = (_e27 + (float(_e28) * _e32));
            vec3 sample_ = (position_4 + (offset_mm * along));
            bool _e37 = is_in_volume(sample_);
            if (_e37) {
                float _e38 = sum;
                float _e39 = stored_at(sample_);
                sum = (_e38 + _e39);
                float _e41 = count;
                count = (_e41 + 1.0);
            }
        }
    }
    float _e47 = sum;
    float _e48 = count;
    float _e52 = count;
    return vec2((_e47 / max(_e48, 1.0)), min(_e52, 1.0));
}

vec2 stored_on(vec3 position_5, vec3 inward_1) {
    uint _e4 = _group_0_binding_0_fs.slab_count;
    if ((_e4 > 0u)) {
        vec2 _e7 = slab_mean(position_5, inward_1);
        return _e7;
    }
    bool _e8 = is_in_volume(position_5);
    if (_e8) {
        float _e9 = stored_at(position_5);
        return vec2(_e9, 1.0);
    }
    return vec2(0.0);
}

vec4 shaded(vec3 position_in_field) {
    vec3 _e1 = inward_at(position_in_field);
    mat4x4 _e4 = _group_0_binding_0_fs.volume_from_field;
    vec3 position_6 = (_e4 * vec4(position_in_field, 1.0)).xyz;
    vec2 _e9 = stored_on(position_6, _e1);
    if ((_e9.y == 0.0)) {
        return vec4(0.0);
    }
    vec3 _e17 = _group_0_binding_0_fs.towards_viewer;
    float facing_1 = -(dot(_e1, _e17));
    float _e21 = brightness(_e9.x);
    vec3 _e22 = color_of(_e21);
    float _e23 = light_on(facing_1);
    vec3 lit = (_e22 * _e23);
    return vec4((floor((lit + vec3(0.5))) / vec3(255.0)), 1.0);
}

OnFacet on_facet(vec3 position_in_patient_1) {
    vec4 patient = vec4(position_in_patient_1, 1.0);
    mat4x4 _e5 = _group_0_binding_0_fs.clip_from_patient;
    mat4x4 _e9 = _group_0_binding_0_fs.field_from_patient;
    return OnFacet((_e5 * patient), (_e9 * patient).xyz);
}

void main() {
    OnFacet point = OnFacet(gl_FragCoord, _vs2fs_location0);
    vec4 _e2 = shaded(point.position_in_field);
    _fs2p_location0 = _e2;
    return;
}

