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
// A line of sight that comes nearer to the isosurface by more than this in a voxel's length is not at an edge: if it gets no
// deeper than half a pixel, it passes through a thin piece.
const STEEP: f32 = 0.8;
// The widest edge, and the shortest step inside of one, in voxels.
const WIDEST: f32 = 2.0;
const SHORTEST_STEP: f32 = 0.5;
// Below every height: no hit.
const MISS: f32 = -1e30;

// A line of sight, in voxel coordinates of the depth field: its position at height 0, and the unit vector towards the viewer.
struct Sight {
    foot: vec3<f32>,
    towards: vec3<f32>,
}

fn along(sight: Sight, height: f32) -> vec3<f32> {
    return sight.foot + height * sight.towards;
}

fn is_map() -> bool {
    return picture.map_units_per_pixel > 0.0;
}

// Where a place lies on its disc: to the right and up from the centre, in radii of the sphere of directions.
fn on_disc(place_in_frame: vec2<f32>) -> vec2<f32> {
    let offset = place_in_frame - picture.map_centre;
    return vec2<f32>(offset.x, -offset.y) * picture.map_units_per_pixel;
}

// The line of sight of a place. On a disc of the flat map, all of them end in the middle of the hemisphere: `render::map`.
fn sight_of(place_in_frame: vec2<f32>) -> Sight {
    if !is_map() {
        return Sight(foot_of(place_in_frame), picture.towards_viewer);
    }
    let place = on_disc(place_in_frame);
    let squared = dot(place, place);
    let stretch = sqrt(max(1.0 - 0.25 * squared, 0.0));
    let direction = vec4<f32>(place * stretch, 1.0 - 0.5 * squared, 0.0);
    return Sight(picture.field_from_frame[3].xyz, (picture.field_from_frame * direction).xyz);
}

// Radii of the rim of a disc and of the end of its margin, and the share of the surface in the margin.
const MAP_RIM: f32 = 1.4142135;
const MAP_MARGIN: f32 = 1.6867829;
const MARGIN_SHARE: f32 = 0.5;

// The share of a pixel that its disc covers; 1 where there is no map.
fn share_on_map(place_in_frame: vec2<f32>) -> f32 {
    if !is_map() {
        return 1.0;
    }
    let radius = length(on_disc(place_in_frame));
    let within = clamp(0.5 + (vec2<f32>(MAP_RIM, MAP_MARGIN) - radius) / picture.map_units_per_pixel, vec2<f32>(0.0), vec2<f32>(1.0));
    return mix(MARGIN_SHARE, 1.0, within.x) * within.y;
}

// The least and the greatest height at which the isosurface may be met: in the ball and the box around it.
//
// What lies at depth D of a ball or a box is in the ball or the box that is smaller by D.
fn reach(sight: Sight) -> vec2<f32> {
    let from_centre = sight.foot - picture.sphere_centre;
    let aside = from_centre - dot(from_centre, sight.towards) * sight.towards;
    let half_squared = picture.sphere_radius * picture.sphere_radius - dot(aside, aside);
    if half_squared < 0.0 || picture.sphere_radius < 0.0 {
        return vec2<f32>(0.0, -1.0);
    }
    let half = sqrt(half_squared);
    let middle = -dot(from_centre, sight.towards);
    // Along a face of the box a line of sight is all inside of it or all outside.
    let direction = select(sight.towards, vec3<f32>(1e-6), abs(sight.towards) < vec3<f32>(1e-6));
    let low = (picture.box_low - sight.foot) / direction;
    let high = (picture.box_high - sight.foot) / direction;
    let near = min(low, high);
    let far = max(low, high);
    // On a map, lines of sight end in the middle of the hemisphere.
    let end = select(middle - half, max(middle - half, 0.0), is_map());
    return vec2<f32>(
        max(max(near.x, near.y), max(near.z, end)),
        min(min(far.x, far.y), min(far.z, middle + half)),
    );
}

// The height of the isosurface between a place above it and one below it, both given as height and distance below the
// isosurface: by false position (the Illinois variant), and where a bend of the field defies that, by halving.
fn between(sight: Sight, above: vec2<f32>, under: vec2<f32>) -> f32 {
    var high = above;
    var low = under;
    var side = 0;
    for (var round = 0; round < MAX_ROUNDS; round++) {
        let share = select(0.5, high.y / (high.y - low.y), round < FALSE_POSITIONS);
        let height = high.x + (low.x - high.x) * share;
        let here = below(along(sight, height));
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

// Follows a line of sight from where it enters the isosurface, until it is outside again or deep enough: the height there, and
// how far below the isosurface it got, in voxels.
fn deepest_below(sight: Sight, start: f32, enough: f32) -> vec2<f32> {
    var height = start;
    var deepest = 0.0;
    for (var steps = 0; steps < MAX_STEPS; steps++) {
        height -= max(1.5 * (enough - deepest), SHORTEST_STEP);
        let here = below(along(sight, height));
        deepest = max(deepest, here);
        if here < 0.0 || deepest >= enough {
            break;
        }
    }
    return vec2<f32>(height, deepest);
}

// What a line of sight shows: the greatest height at which it enters the isosurface, and the share of its pixel that is covered,
// at least half. Where it misses the isosurface, less than half is covered, and the height is where it passes nearest.
//
// How far below the isosurface a line of sight gets, or by how much it misses it, is how far the edge of the picture is from the
// pixel's centre: that is the share.
//
// A step is at most as long as it is known to be safe, from its beginning and from its end: nothing is passed over but
// what is less than NEAR voxels thick along the line of sight.
fn first_hit(sight: Sight) -> vec2<f32> {
    let ends = reach(sight);
    let width = min(length(picture.field_from_frame[0].xyz), WIDEST);
    var found = vec2<f32>(MISS, 0.0);
    var height = ends.y;
    var distance = -below(along(sight, height));
    // How much nearer the isosurface comes in a voxel's length.
    var slope = 1.0;
    for (var steps = 0; steps < MAX_STEPS; steps++) {
        if height < ends.x {
            break;
        }
        var hit = height;
        if distance > TOLERANCE {
            let passed = 0.5 - distance / width;
            if passed > found.y {
                found = vec2<f32>(height, passed);
            }
            let safe = distance / STEEPEST;
            let passing = 1.125 * distance;
            var step = max(2.0 * RELAXATION * distance / (STEEPEST + max(slope, 0.0)), safe);
            if passing < NEAR * slope {
                step = passing / slope;
            }
            var ahead = -below(along(sight, height - step));
            if ahead > 0.0 {
                if safe + ahead / STEEPEST < step {
                    step = safe;
                    ahead = -below(along(sight, height - step));
                }
                slope = (distance - ahead) / step;
                height -= step;
                distance = ahead;
                continue;
            }
            hit = between(sight, vec2<f32>(height, -distance), vec2<f32>(height - step, -ahead));
        }
        // What lies behind an edge covers the pixel's other part.
        if found.y >= 0.5 {
            found.y = 1.0;
            break;
        }
        found = vec2<f32>(hit, 1.0);
        if slope > STEEP {
            break;
        }
        let inside = deepest_below(sight, hit, 0.5 * width);
        found.y = min(0.5 + inside.y / width, 1.0);
        if found.y >= 1.0 {
            break;
        }
        height = inside.x;
        distance = -below(along(sight, height));
        slope = 0.0;
    }
    return found;
}

// What a line of sight shows: the height, and the covered share of the pixel. A disc of a map is full of surface: its own edge alone
// is soft.
fn shown_at(place_in_frame: vec2<f32>, sight: Sight) -> vec2<f32> {
    let covered = share_on_map(place_in_frame);
    if covered <= 0.0 {
        return vec2<f32>(MISS, 0.0);
    }
    let found = first_hit(sight);
    let share = select(found.y, select(0.0, 1.0, found.y >= 0.5), is_map());
    return vec2<f32>(found.x, share * covered);
}

@fragment
fn trace_shaded(pixel: OnScreen) -> @location(0) vec4<f32> {
    let sight = sight_of(pixel.place_in_frame);
    let shown = shown_at(pixel.place_in_frame, sight);
    if shown.y <= 0.0 {
        return vec4<f32>(0.0);
    }
    return shaded(along(sight, shown.x), sight.towards) * shown.y;
}

// The height of the isosurface above the plane through the target's centre, on a map above the middle of the hemisphere, in mm; MISS
// where there is none.
@fragment
fn trace_height(pixel: OnScreen) -> @location(0) f32 {
    let sight = sight_of(pixel.place_in_frame);
    let shown = shown_at(pixel.place_in_frame, sight);
    let is_covered = select(shown.y >= 0.5, shown.y > 0.0, is_map());
    let place = along(sight, shown.x);
    let is_there = is_covered && known_at(place, around(place)) > 0.0;
    return select(MISS, shown.x * picture.voxel_mm, is_there);
}
