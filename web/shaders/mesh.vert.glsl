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
struct OnFacet {
    vec4 position;
    vec3 position_in_field;
};
const float UNKNOWN = -1e30;

layout(std140) uniform Picture_block_0Vertex { Picture _group_0_binding_0_vs; };

layout(location = 0) in vec3 _p2vs_location0;
smooth centroid out vec3 _vs2fs_location0;

vec2 defined_part(vec2 texel) {
    return vec2((texel.x / max(texel.y, 1e-6)), texel.y);
}

bool is_in_volume(vec3 position_1) {
    vec3 _e5 = _group_0_binding_0_vs.volume_size;
    return all(equal(clamp(position_1, vec3(-0.5), (_e5 - vec3(0.5))), position_1));
}

float brightness(float stored) {
    float _e3 = _group_0_binding_0_vs.window_black;
    float _e7 = _group_0_binding_0_vs.window_factor;
    float _e11 = _group_0_binding_0_vs.window_offset;
    float ramp = (((stored - _e3) * _e7) + _e11);
    uint _e15 = _group_0_binding_0_vs.window_is_sigmoid;
    if ((_e15 == 1u)) {
        return (255.0 / (1.0 + exp(-(ramp))));
    }
    return clamp(ramp, 0.0, 255.0);
}

float overlay_share(float value) {
    uint _e4 = _group_0_binding_0_vs.overlay_is_diverging;
    float size = ((_e4 > 0u) ? abs(value) : value);
    float _e10 = _group_0_binding_0_vs.overlay_threshold;
    float _e14 = _group_0_binding_0_vs.overlay_steepness;
    float rise = clamp(((size - _e10) * _e14), 0.0, 1.0);
    float _e21 = _group_0_binding_0_vs.overlay_opacity;
    return (_e21 * ((rise * rise) * (3.0 - (2.0 * rise))));
}

float overlay_level(float value_1) {
    float _e3 = _group_0_binding_0_vs.overlay_low;
    float _e7 = _group_0_binding_0_vs.overlay_factor;
    return clamp(((value_1 - _e3) * _e7), 0.0, 255.0);
}

float light_on(float facing) {
    float _e3 = _group_0_binding_0_vs.ambient;
    float _e6 = _group_0_binding_0_vs.ambient;
    return (_e3 + ((1.0 - _e6) * clamp(facing, 0.0, 1.0)));
}

float known_mm(vec3 position_in_field_2) {
    float least = 0.0;
    int index_1 = 1;
    vec4 place = vec4(position_in_field_2, 1.0);
    vec4 _e6 = _group_0_binding_0_vs.cuts[0];
    least = dot(_e6, place);
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
            vec4 _e19 = _group_0_binding_0_vs.cuts[_e17];
            least = min(_e14, dot(_e19, place));
        }
    }
    float _e25 = least;
    return _e25;
}

float known_at(vec3 position_in_field_3) {
    float _e1 = known_mm(position_in_field_3);
    return ((_e1 >= 0.0) ? 1.0 : 0.0);
}

OnFacet on_facet(vec3 position_in_patient_1) {
    vec4 patient = vec4(position_in_patient_1, 1.0);
    mat4x4 _e5 = _group_0_binding_0_vs.clip_from_patient;
    mat4x4 _e9 = _group_0_binding_0_vs.field_from_patient;
    return OnFacet((_e5 * patient), (_e9 * patient).xyz);
}

void main() {
    vec3 position_in_patient = _p2vs_location0;
    OnFacet _e1 = on_facet(position_in_patient);
    gl_Position = _e1.position;
    _vs2fs_location0 = _e1.position_in_field;
    return;
}

