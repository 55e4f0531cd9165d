// The isosurface {depth = D} itself: each pixel follows its line of sight to it.

// Sphere tracing (J. C. Hart, The Visual Computer 12, 1996) with over-relaxation (B. Keinert et al., STAG 2014).

// How far a hit may be from the isosurface, in voxels of depth.
const TOLERANCE: f32 = 0.005;
// The most that the trilinear depth changes in a voxel's length: each component of its gradient is a mean of differences
// between neighbours, of at most 1 voxel, and values are rounded.
const STEEPEST: f32 = 1.75;
// Where the isosurface is thought to be at most this far ahead, a step tries to pass it, in voxels.
const NEAR: f32 = 1.0;
// Share of the longest step that would still be safe if the depth went on as before.
const RELAXATION: f32 = 0.95;
// More steps than any line of sight takes through a grid of 512 voxels a side.
const MAX_STEPS: i32 = 8192;
// How often the isosurface is looked for by false position, and in all, between two steps.
const FALSE_POSITIONS: i32 = 6;
const MAX_ROUNDS: i32 = 18;
// Below every height: no hit.
const MISS: f32 = -1e30;

// The least and the greatest height at which the isosurface may be met: in the ball and the box around it.
//
// What lies at depth D of a ball or a box is in the ball or the box that is smaller by D.
fn reach(foot: vec3<f32>) -> vec2<f32> {
    let from_centre = foot - picture.sphere_centre;
    let aside = from_centre - dot(from_centre, picture.towards_viewer) * picture.towards_viewer;
    let half_squared = picture.sphere_radius * picture.sphere_radius - dot(aside, aside);
    if half_squared < 0.0 || picture.sphere_radius < 0.0 {
        return vec2<f32>(0.0, -1.0);
    }
    let half = sqrt(half_squared);
    let middle = -dot(from_centre, picture.towards_viewer);
    // Along a face of the box a line of sight is all inside of it or all outside.
    let direction = select(picture.towards_viewer, vec3<f32>(1e-6), abs(picture.towards_viewer) < vec3<f32>(1e-6));
    let low = (picture.box_low - foot) / direction;
    let high = (picture.box_high - foot) / direction;
    let near = min(low, high);
    let far = max(low, high);
    return vec2<f32>(
        max(max(near.x, near.y), max(near.z, middle - half)),
        min(min(far.x, far.y), min(far.z, middle + half)),
    );
}

// The height of the isosurface between a place above it and one below it, both given as height and distance below the
// isosurface: by false position (the Illinois variant), and where a bend of the field defies that, by halving.
fn between(foot: vec3<f32>, above: vec2<f32>, under: vec2<f32>) -> f32 {
    var high = above;
    var low = under;
    var side = 0;
    for (var round = 0; round < MAX_ROUNDS; round++) {
        let share = select(0.5, high.y / (high.y - low.y), round < FALSE_POSITIONS);
        let height = high.x + (low.x - high.x) * share;
        let here = below(at_height(foot, height));
        if abs(here) <= TOLERANCE {
            return height;
        }
        if here < 0.0 {
            high = vec2<f32>(height, here);
            low.y *= select(1.0, 0.5, side == -1);
            side = -1;
        } else {
            low = vec2<f32>(height, here);
            high.y *= select(1.0, 0.5, side == 1);
            side = 1;
        }
    }
    return 0.5 * (high.x + low.x);
}

// The greatest height at which a line of sight enters the isosurface, or MISS.
//
// A step is at most as long as it is known to be safe, from its beginning and from its end: nothing is passed over but
// what is less than NEAR voxels thick along the line of sight.
fn first_hit(foot: vec3<f32>) -> f32 {
    let ends = reach(foot);
    if ends.x > ends.y {
        return MISS;
    }
    var height = ends.y;
    var distance = -below(at_height(foot, height));
    // How much nearer the isosurface comes in a voxel's length.
    var slope = 1.0;
    for (var steps = 0; steps < MAX_STEPS; steps++) {
        if distance <= TOLERANCE {
            return height;
        }
        if height < ends.x {
            return MISS;
        }
        let safe = distance / STEEPEST;
        let passing = 1.125 * distance;
        var step = max(2.0 * RELAXATION * distance / (STEEPEST + max(slope, 0.0)), safe);
        if passing < NEAR * slope {
            step = passing / slope;
        }
        var ahead = -below(at_height(foot, height - step));
        if ahead <= 0.0 {
            return between(foot, vec2<f32>(height, -distance), vec2<f32>(height - step, -ahead));
        }
        if safe + ahead / STEEPEST < step {
            step = safe;
            ahead = -below(at_height(foot, height - step));
        }
        slope = (distance - ahead) / step;
        height -= step;
        distance = ahead;
    }
    return MISS;
}

@fragment
fn trace_shaded(pixel: OnScreen) -> @location(0) vec4<f32> {
    let foot = foot_of(pixel.place_in_frame);
    let height = first_hit(foot);
    if height <= MISS {
        return vec4<f32>(0.0);
    }
    return shaded(at_height(foot, height));
}

// The height of the isosurface above the plane through the target's centre, in mm; MISS where there is none.
@fragment
fn trace_height(pixel: OnScreen) -> @location(0) f32 {
    let foot = foot_of(pixel.place_in_frame);
    let height = first_hit(foot);
    let is_there = height > MISS && known_at(at_height(foot, height)) > 0.0;
    return select(MISS, height * picture.voxel_mm, is_there);
}
