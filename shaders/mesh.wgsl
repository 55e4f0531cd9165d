// The shrunk mesh: each pixel is shaded at its point of the facet.

struct OnFacet {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(perspective, centroid) position_in_field: vec3<f32>,
}

fn on_facet(position_in_patient: vec3<f32>) -> OnFacet {
    let patient = vec4<f32>(position_in_patient, 1.0);
    return OnFacet(
        picture.clip_from_patient * patient,
        (picture.field_from_patient * patient).xyz,
    );
}

// Vertices in LPS mm.
@vertex
fn mesh_vertex(@location(0) position_in_patient: vec3<f32>) -> OnFacet {
    return on_facet(position_in_patient);
}

@fragment
fn mesh_shaded(point: OnFacet) -> @location(0) vec4<f32> {
    return shaded(point.position_in_field, picture.towards_viewer);
}

// Below every height: nothing is known of the facet there.
const UNKNOWN: f32 = -1e30;

// The height of the facet above the plane through the target's centre, in mm.
@fragment
fn mesh_height(point: OnFacet) -> @location(0) f32 {
    let from_centre = point.position_in_field - picture.sphere_centre;
    let height = dot(from_centre, picture.towards_viewer) * picture.voxel_mm;
    return select(UNKNOWN, height, known_at(point.position_in_field, around(point.position_in_field)) > 0.0);
}
