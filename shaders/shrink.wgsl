// The mesh of any depth from the table of all depths: `Isocortex paths` of the service, straight in two textures.

struct Paths {
    // LPS mm of the stored position 0, 0, 0.
    origin_in_patient: vec3<f32>,
    // Millimetres in a step of a stored coordinate.
    step_mm: f32,
    depth_mm: f32,
    // Depth from a row to the next.
    row_mm: f32,
    // The row at or before the depth; at most the last but one.
    row: u32,
    vertex_count: u32,
    // The finer pieces that follow the row.
    first_piece: u32,
    piece_count: u32,
}

// Words of a finer piece: vertex, two depths (f32), the stored positions of its ends (six u16).
const PIECE_WORDS: u32 = 6u;

@group(1) @binding(0) var<uniform> paths: Paths;
// Stored positions, one a texel, row after row, broken into lines of the texture's width.
@group(1) @binding(1) var rows: texture_2d<u32>;
// The words of the pieces, one a texel, broken likewise.
@group(1) @binding(2) var pieces: texture_2d<u32>;

fn stored_position(index: u32) -> vec3<f32> {
    let width = textureDimensions(rows).x;
    let texel = vec2<i32>(i32(index % width), i32(index / width));
    return vec3<f32>(textureLoad(rows, texel, 0).xyz);
}

fn piece_word(index: u32) -> u32 {
    let width = textureDimensions(pieces).x;
    let texel = vec2<i32>(i32(index % width), i32(index / width));
    return textureLoad(pieces, texel, 0).x;
}

fn low_half(word: u32) -> f32 {
    return f32(word & 0xffffu);
}

fn high_half(word: u32) -> f32 {
    return f32(word >> 16u);
}

// The stored position of a vertex between the ends of a piece.
fn on_piece(start: u32, depths_mm: vec2<f32>) -> vec3<f32> {
    let first = piece_word(start + 3u);
    let middle = piece_word(start + 4u);
    let last = piece_word(start + 5u);
    let near = vec3<f32>(low_half(first), high_half(first), low_half(middle));
    let far = vec3<f32>(high_half(middle), low_half(last), high_half(last));
    return mix(near, far, (paths.depth_mm - depths_mm.x) / (depths_mm.y - depths_mm.x));
}

// The first piece after the row that is of a vertex or of one after it: pieces are in the order of their vertices.
fn first_piece_of(vertex: u32) -> u32 {
    var low = paths.first_piece;
    var high = paths.first_piece + paths.piece_count;
    while low < high {
        let middle = (low + high) / 2u;
        if piece_word(middle * PIECE_WORDS) < vertex {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

// The stored position of a vertex at the depth asked for.
fn shrunk(vertex: u32) -> vec3<f32> {
    let index = paths.row * paths.vertex_count + vertex;
    let fraction = (paths.depth_mm - f32(paths.row) * paths.row_mm) / paths.row_mm;
    var position = mix(stored_position(index), stored_position(index + paths.vertex_count), fraction);
    let end = paths.first_piece + paths.piece_count;
    for (var piece = first_piece_of(vertex); piece < end; piece++) {
        let start = piece * PIECE_WORDS;
        if piece_word(start) != vertex {
            break;
        }
        let depths_mm = vec2<f32>(bitcast<f32>(piece_word(start + 1u)), bitcast<f32>(piece_word(start + 2u)));
        if depths_mm.x < paths.depth_mm && paths.depth_mm <= depths_mm.y {
            position = on_piece(start, depths_mm);
        }
    }
    return position;
}

// How often a vertex near the envelope is moved, and how far at once, in voxels: `render::settle`.
const MOVES: i32 = 4;
const FARTHEST: f32 = 1.0;

// A vertex of the mesh as it is drawn: near the envelope it goes along the gradient to the isosurface without terraces.
fn settled(position_in_patient: vec3<f32>) -> vec3<f32> {
    if picture.smooth_share == 0.0 {
        return position_in_patient;
    }
    let start = (picture.field_from_patient * vec4<f32>(position_in_patient, 1.0)).xyz;
    var place = start;
    for (var move_ = 0; move_ < MOVES; move_++) {
        place -= inward_at(place) * clamp(below(place), -FARTHEST, FARTHEST);
    }
    return position_in_patient + picture.voxel_mm * (place - start);
}

// The position of a vertex at the depth asked for, in LPS mm.
fn shrunk_position(vertex: u32) -> vec3<f32> {
    return settled(paths.origin_in_patient + paths.step_mm * shrunk(vertex));
}

struct Shrunk {
    // There is nothing on the screen.
    @builtin(position) nowhere: vec4<f32>,
    @location(0) position_in_patient: vec3<f32>,
}

// Kept, and drawn with from then on.
@vertex
fn shrunk_vertex(@builtin(vertex_index) vertex: u32) -> Shrunk {
    return Shrunk(vec4<f32>(0.0), shrunk_position(vertex));
}
