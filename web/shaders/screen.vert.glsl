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

layout(std140) uniform Picture_block_0Vertex { Picture _group_0_binding_0_vs; };

smooth out vec2 _vs2fs_location0;

vec2 defined_part(vec2 texel) {
    return vec2((texel.x / max(texel.y, 1e-6)), texel.y);
}

bool is_in_volume(vec3 position_1) {
    vec3 _e5 = _group_0_binding_0_vs.volume_size;
    return all(equal(clamp(position_1, vec3(-0.5), (_e5 - vec3(0.5))), position_1));
}

vec3 inward_of(vec4 around_1) {
    vec3 gradient = around_1.xyz;
    return (gradient / vec3(max(length(gradient), 1e-6)));
}

float unfenced_of(vec4 around_2) {
    return ((around_2.w < 0.5) ? 1.0 : 0.0);
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

float known_at(vec3 position_in_field_3, vec4 around_3) {
    float _e2 = known_mm(position_in_field_3);
    float _e8 = unfenced_of(around_3);
    return (((_e2 >= 0.0) ? 1.0 : 0.0) * _e8);
}

vec3 foot_of(vec2 place_in_frame) {
    mat4x4 _e3 = _group_0_binding_0_vs.field_from_frame;
    return (_e3 * vec4(place_in_frame, 0.0, 1.0)).xyz;
}

vec3 at_height(vec3 foot, float height) {
    vec3 _e4 = _group_0_binding_0_vs.towards_viewer;
    return (foot + (height * _e4));
}

vec3 along(Sight sight, float height_1) {
    return (sight.foot + (height_1 * sight.towards));
}

bool is_map() {
    float _e2 = _group_0_binding_0_vs.map_units_per_pixel;
    return (_e2 > 0.0);
}

vec2 on_disc(vec2 place_in_frame_1) {
    vec2 _e3 = _group_0_binding_0_vs.map_centre;
    vec2 offset = (place_in_frame_1 - _e3);
    float _e11 = _group_0_binding_0_vs.map_units_per_pixel;
    return (vec2(offset.x, -(offset.y)) * _e11);
}

Sight sight_of(vec2 place_in_frame_2) {
    bool _e1 = is_map();
    if (!(_e1)) {
        vec3 _e3 = foot_of(place_in_frame_2);
        vec3 _e6 = _group_0_binding_0_vs.towards_viewer;
        return Sight(_e3, _e6);
    }
    vec2 _e8 = on_disc(place_in_frame_2);
    float squared = dot(_e8, _e8);
    float stretch = sqrt(max((1.0 - (0.25 * squared)), 0.0));
    vec4 direction = vec4((_e8 * stretch), (1.0 - (0.5 * squared)), 0.0);
    vec4 _e27 = _group_0_binding_0_vs.field_from_frame[3];
    mat4x4 _e31 = _group_0_binding_0_vs.field_from_frame;
    return Sight(_e27.xyz, (_e31 * direction).xyz);
}

float share_on_map(vec2 place_in_frame_3) {
    bool _e1 = is_map();
    if (!(_e1)) {
        return 1.0;
    }
    vec2 _e4 = on_disc(place_in_frame_3);
    float radius = length(_e4);
    float _e13 = _group_0_binding_0_vs.map_units_per_pixel;
    vec2 within = clamp((vec2(0.5) + ((vec2(1.4142135, 1.686783) - vec2(radius)) / vec2(_e13))), vec2(0.0), vec2(1.0));
    return (mix(MARGIN_SHARE, 1.0, within.x) * within.y);
}

vec2 reach(Sight sight_1) {
    bool local_2 = false;
    vec3 _e4 = _group_0_binding_0_vs.sphere_centre;
    vec3 from_centre = (sight_1.foot - _e4);
    vec3 aside = (from_centre - (dot(from_centre, sight_1.towards) * sight_1.towards));
    float _e13 = _group_0_binding_0_vs.sphere_radius;
    float _e16 = _group_0_binding_0_vs.sphere_radius;
    float half_squared = ((_e13 * _e16) - dot(aside, aside));
    if (!((half_squared < 0.0))) {
        float _e27 = _group_0_binding_0_vs.sphere_radius;
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
    vec3 _e50 = _group_0_binding_0_vs.box_low;
    vec3 low_1 = ((_e50 - sight_1.foot) / direction_1);
    vec3 _e56 = _group_0_binding_0_vs.box_high;
    vec3 high_1 = ((_e56 - sight_1.foot) / direction_1);
    vec3 near = min(low_1, high_1);
    vec3 far = max(low_1, high_1);
    bool _e66 = is_map();
    float end = (_e66 ? max((middle - half_), 0.0) : (middle - half_));
    return vec2(max(max(near.x, near.y), max(near.z, end)), min(min(far.x, far.y), min(far.z, (middle + half_))));
}

void main() {
    uint vertex = uint(gl_VertexID);
    vec2 corner = vec2(((float((vertex & 1u)) * 4.0) - 1.0), ((float((vertex >> 1u)) * 4.0) - 1.0));
    vec2 _e29 = _group_0_binding_0_vs.size;
    vec2 place_1 = (vec2((0.5 + (0.5 * corner.x)), (0.5 - (0.5 * corner.y))) * _e29);
    OnScreen _tmp_return = OnScreen(vec4(corner, 0.0, 1.0), place_1);
    gl_Position = _tmp_return.position;
    _vs2fs_location0 = _tmp_return.place_in_frame;
    return;
}

