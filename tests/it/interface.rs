//! What a ready case answers: meshes, textures, pictures.

use std::io::Read as _;

use axum::http::StatusCode;
use base64::prelude::{BASE64_STANDARD, Engine as _};

use crate::head::plain_head;
use crate::server::{Answer, Server};

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

#[tokio::test]
async fn a_mesh_has_the_vertices_and_triangles_that_it_promises() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for (query, vertices) in [("", 902), ("contours=7&points=11", 79), ("paths=flow", 902)] {
        let mesh = server.get(&format!("{case}/mesh?depth_mm=8&{query}")).await;
        assert_eq!(mesh.positions().len(), vertices, "{query}");
    }
    let triangles = server
        .get(&format!("{case}/mesh/triangles?contours=7&points=11"))
        .await;
    assert_eq!(triangles.body.len(), 12 * 2 * 7 * 11);
    let numbers = (0..triangles.body.len())
        .step_by(4)
        .map(|at| u32_at(&triangles.body, at));
    assert_eq!(numbers.max(), Some(78));
}

#[tokio::test]
async fn a_deeper_mesh_lies_within_a_shallower_one() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let mut widest = f32::INFINITY;
    for depth in [0, 5, 10, 20, 40] {
        let mesh = server
            .get(&format!("{case}/mesh?depth_mm={depth}"))
            .await
            .positions();
        let lefts = mesh.iter().map(|position| position[0]);
        let width = lefts.clone().fold(f32::MIN, f32::max) - lefts.fold(f32::MAX, f32::min);
        assert!(width < widest, "{depth} mm: {width} mm wide");
        widest = width;
    }
}

/// The arrays of a GIFTI file: the text around the data of each, and its numbers, of four bytes each.
pub(crate) fn gifti_arrays(file: &[u8]) -> Vec<(String, Vec<u32>)> {
    let text = std::str::from_utf8(file).unwrap();
    let array = |text: &str| {
        let (about, rest) = text.split_once("<Data>").unwrap();
        let (data, rest) = rest.split_once("</Data>").unwrap();
        let packed = BASE64_STANDARD.decode(data).unwrap();
        let mut bytes = Vec::new();
        let mut decoder = flate2::read::ZlibDecoder::new(&packed[..]);
        decoder.read_to_end(&mut bytes).unwrap();
        let numbers = (0..bytes.len()).step_by(4);
        let numbers = numbers.map(|at| u32_at(&bytes, at)).collect();
        (format!("{about}{rest}"), numbers)
    };
    text.split("<DataArray ").skip(1).map(array).collect()
}

/// A mesh that a file holds, its corners in LPS mm.
pub(crate) struct MeshFile {
    pub(crate) corners: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl MeshFile {
    pub(crate) fn read(media_type: &str, file: &[u8]) -> Self {
        let numbers_at = |start: usize, count: usize| {
            let at = (0..count).map(|number| start + 4 * number);
            at.map(|at| u32_at(file, at)).collect::<Vec<_>>()
        };
        let thrice = |numbers: &[u32]| numbers.as_chunks().0.to_vec();
        let places = |numbers: &[u32]| {
            let place = |bits: [u32; 3]| bits.map(f32::from_bits);
            thrice(numbers).into_iter().map(place).collect()
        };
        match media_type {
            "model/gltf-binary" => {
                let text = 20 + u32_at(file, 12) as usize;
                let document: serde_json::Value = serde_json::from_slice(&file[20..text]).unwrap();
                let count = |accessor: usize| {
                    document["accessors"][accessor]["count"].as_u64().unwrap() as usize
                };
                let (corners, numbers) = (3 * count(0), count(1));
                Self {
                    corners: places(&numbers_at(text + 8, corners)),
                    triangles: thrice(&numbers_at(text + 8 + 4 * corners, numbers)),
                }
            }
            "model/stl" => {
                // Corners are the same if their bits are.
                let mut known = std::collections::HashMap::new();
                let mut corners = Vec::new();
                let facets = (84..file.len()).step_by(50);
                let triangles = facets.map(|at| {
                    [12, 24, 36].map(|corner| {
                        let bits = numbers_at(at + corner, 3);
                        *known.entry(bits).or_insert_with_key(|bits| {
                            corners.push([0, 1, 2].map(|axis| f32::from_bits(bits[axis])));
                            corners.len() as u32 - 1
                        })
                    })
                });
                let triangles = triangles.collect();
                Self { corners, triangles }
            }
            "model/obj" => {
                let text = std::str::from_utf8(file).unwrap();
                let of = |kind: &'static str| {
                    let lines = text.lines().filter_map(move |line| line.strip_prefix(kind));
                    lines.map(|line| line.split(' ').collect::<Vec<_>>())
                };
                let corner = |words: Vec<&str>| [0, 1, 2].map(|axis| words[axis].parse().unwrap());
                let triangle = |words: Vec<&str>| {
                    [0, 1, 2].map(|corner| words[corner].parse::<u32>().unwrap() - 1)
                };
                Self {
                    corners: of("v ").map(corner).collect(),
                    triangles: of("f ").map(triangle).collect(),
                }
            }
            "model/gifti+xml" => {
                let [(points, positions), (_, triangles)] = &gifti_arrays(file)[..] else {
                    panic!("a mesh has two arrays");
                };
                assert_eq!(points.matches("NIFTI_XFORM_SCANNER_ANAT").count(), 2);
                // A row on each line, without which nibabel reads no matrix.
                assert!(points.contains(">\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n<"));
                let in_scanner: Vec<[f32; 3]> = places(positions);
                Self {
                    corners: in_scanner.iter().map(|&[x, y, z]| [-x, -y, z]).collect(),
                    triangles: thrice(triangles),
                }
            }
            "application/x-freesurfer" => {
                let start = file.windows(2).position(|two| two == b"\n\n").unwrap() + 2;
                let words = |start: usize, count: usize| {
                    let at = (0..count).map(|number| start + 4 * number);
                    at.map(|at| u32_at(file, at).swap_bytes())
                        .collect::<Vec<_>>()
                };
                let [vertices, faces] = words(start, 2)[..] else {
                    panic!("two counts");
                };
                let numbers = start + 8 + 12 * vertices as usize;
                let footer = numbers + 12 * faces as usize;
                assert_eq!(words(footer, 3), [2, 0, 20]);
                let footer = std::str::from_utf8(&file[footer + 12..]).unwrap();
                let [x, y, z, centre] = ["xras", "yras", "zras", "cras"].map(|key| {
                    let line = footer.lines().find(|line| line.starts_with(key)).unwrap();
                    let (_, numbers) = line.split_once('=').unwrap();
                    let mut numbers = numbers.split_whitespace();
                    let next = [(); 3].map(|()| numbers.next().unwrap().parse().unwrap());
                    glam::DVec3::from_array(next)
                });
                let corner = |[right, front, up]: [f32; 3]| {
                    let scanner =
                        centre - x * f64::from(right) - y * f64::from(up) + z * f64::from(front);
                    [-scanner.x, -scanner.y, scanner.z].map(|along| along as f32)
                };
                let in_volume: Vec<[f32; 3]> = places(&words(start + 8, 3 * vertices as usize));
                Self {
                    corners: in_volume.into_iter().map(corner).collect(),
                    triangles: thrice(&words(numbers, 3 * faces as usize)),
                }
            }
            _ => {
                let end = b"end_header\n";
                let start = file.windows(end.len()).position(|window| window == end);
                let start = start.unwrap() + end.len();
                let head = std::str::from_utf8(&file[..start]).unwrap();
                let vertices = head
                    .lines()
                    .find_map(|line| line.strip_prefix("element vertex "));
                let vertices = 3 * vertices.unwrap().parse::<usize>().unwrap();
                let faces = (start + 4 * vertices..file.len()).step_by(13);
                Self {
                    corners: places(&numbers_at(start, vertices)),
                    triangles: faces
                        .flat_map(|at| thrice(&numbers_at(at + 1, 3)))
                        .collect(),
                }
            }
        }
    }

    fn corners_of(&self, triangle: [u32; 3]) -> [glam::DVec3; 3] {
        triangle.map(|vertex| {
            let corner = self.corners[vertex as usize];
            glam::DVec3::from_array(corner.map(f64::from))
        })
    }

    /// The triangles that have no area.
    fn flat(&self) -> Vec<[u32; 3]> {
        let is_flat = |triangle: &[u32; 3]| {
            let [a, b, c] = self.corners_of(*triangle);
            (b - a).cross(c - a) == glam::DVec3::ZERO
        };
        self.triangles.iter().copied().filter(is_flat).collect()
    }

    fn volume_ml(&self) -> f64 {
        let parts = self.triangles.iter().map(|&triangle| {
            let [a, b, c] = self.corners_of(triangle);
            a.dot(b.cross(c)) / 6000.0
        });
        parts.sum()
    }

    /// Whether each edge belongs to two triangles, in opposite directions.
    pub(crate) fn is_closed(&self) -> bool {
        let edges = self
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let count = edges.clone().count();
        let edges: std::collections::HashSet<_> = edges.collect();
        edges.len() == count && edges.iter().all(|&[a, b]| edges.contains(&[b, a]))
    }
}

/// The media types of files, and their names in addresses.
const FILES: [(&str, &str); 6] = [
    ("model/gltf-binary", "glb"),
    ("model/stl", "stl"),
    ("model/obj", "obj"),
    ("application/ply", "ply"),
    ("model/gifti+xml", "gifti"),
    ("application/x-freesurfer", "freesurfer"),
];

#[tokio::test]
async fn a_solid_is_closed_and_the_same_in_every_format() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let distance = server.get(&format!("{case}/distance")).await;
    let step_mm: f64 = distance.header("x-isocortex-scale").parse().unwrap();
    let affine = distance.header("x-isocortex-patient-from-voxel").split(',');
    let voxel_mm: f64 = affine.map(|x| x.parse().unwrap()).next().unwrap();
    let depths = distance.body.chunks_exact(2);
    let depths: Vec<f64> = depths
        .map(|pair| step_mm * f64::from(i16::from_le_bytes([pair[0], pair[1]])))
        .collect();
    for depth in ["0", "4.5", "8", "21.3"] {
        let address = format!("{case}/mesh?depth_mm={depth}&solid=true");
        let mut volumes = Vec::new();
        for (media_type, _) in FILES {
            let answer = server.get_with(&address, &[("accept", media_type)]).await;
            assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
            assert_eq!(answer.header("content-type"), media_type);
            assert_eq!(answer.header("x-isocortex-depth-mm"), depth);
            assert_eq!(answer.header("x-isocortex-unknown-vertices"), "0");
            assert_eq!(answer.header("x-isocortex-shallow-vertices"), "0");
            let file = MeshFile::read(media_type, &answer.body);
            assert!(file.is_closed(), "{media_type} at {depth} mm");
            assert_eq!(file.flat().len(), 0, "{media_type} at {depth} mm");
            volumes.push((file.triangles.len(), file.volume_ml()));
        }
        let (triangles, volume_ml) = volumes[0];
        // FreeSurfer's coordinates begin at the centre of the volume, and are rounded there.
        let is_same = |&(count, ml): &(usize, f64)| {
            count == triangles && (ml - volume_ml).abs() < 1e-4 * volume_ml
        };
        assert!(volumes.iter().all(is_same), "{volumes:?}");
        // The voxels whose centres are inside; half of those on the surface. Up to 5 voxels of 4 mm below the envelope the isosurface is
        // smoothed, and a little smaller.
        let depth: f64 = depth.parse().unwrap();
        let inside = depths
            .iter()
            .map(|&there| f64::from(u8::from(there > depth)) + f64::from(u8::from(there >= depth)));
        let expected_ml = inside.sum::<f64>() / 2.0 * voxel_mm.powi(3) / 1000.0;
        let ratio = volume_ml / expected_ml;
        assert!(
            (0.9..1.03).contains(&ratio),
            "{volume_ml} of {expected_ml} ml at {depth} mm"
        );
    }
    // Without a wish for a format it is the first that holds triangles.
    let address = format!("{case}/mesh?depth_mm=8&solid=true");
    let answer = server.get(&address).await;
    assert_eq!(answer.header("content-type"), FILES[0].0);
    let raw = [("accept", "application/octet-stream")];
    let refused = server.get_with(&address, &raw).await;
    assert_eq!(refused.problem(), "not-acceptable");
    // Nothing is as deep as the deepest voxel here, whose depth is stored with a rounding error.
    let refused = server
        .get(&format!("{case}/mesh?depth_mm=9000&solid=true"))
        .await;
    assert_eq!(refused.status, StatusCode::BAD_REQUEST);
    assert_eq!(refused.problem(), "query-value-out-of-range");
    assert_eq!(refused.json()["parameter"], "depth_mm");
}

#[tokio::test]
async fn every_format_holds_the_same_mesh_without_the_triangles_that_have_no_area() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let address = format!("{case}/mesh?depth_mm=8");
    let corners = server.get(&address).await.positions();
    let triangles = server.get(&format!("{case}/mesh/triangles")).await.body;
    let numbers = (0..triangles.len()).step_by(4);
    let numbers: Vec<_> = numbers.map(|at| u32_at(&triangles, at)).collect();
    let triangles = numbers.as_chunks().0.to_vec();
    let mut expected = MeshFile { corners, triangles };
    let flat = expected.flat();
    expected
        .triangles
        .retain(|triangle| !flat.contains(triangle));
    assert!((100..500).contains(&flat.len()), "{}", flat.len());
    for (media_type, name) in FILES {
        let answer = server.get_with(&address, &[("accept", media_type)]).await;
        assert_eq!(answer.header("content-type"), media_type);
        let named = server.get(&format!("{address}&format={name}")).await;
        assert_eq!(named.header("content-type"), media_type);
        assert!(named.body == answer.body, "{name}");
        let file = MeshFile::read(media_type, &answer.body);
        // A file of STL has no numbers.
        let places = |mesh: &MeshFile| {
            let each = mesh
                .triangles
                .iter()
                .map(|&triangle| mesh.corners_of(triangle));
            each.collect::<Vec<_>>()
        };
        if media_type == "application/x-freesurfer" {
            // Its coordinates begin elsewhere, and are rounded there.
            assert_eq!(file.triangles, expected.triangles);
            let pairs = file.corners.iter().zip(&expected.corners);
            let mut pairs = pairs.map(|pair| glam::Vec3::from(*pair.0).distance((*pair.1).into()));
            assert!(pairs.all(|apart_mm| apart_mm < 1e-4));
            continue;
        }
        assert_eq!(places(&file), places(&expected), "{media_type}");
        if media_type != "model/stl" {
            assert_eq!(file.corners, expected.corners, "{media_type}");
        }
    }
}

/// Shrinks a mesh by the table of its paths, as a client would: following the wire README alone.
fn shrunk_by_client(file: &[u8], depth_mm: f32) -> Vec<[f32; 3]> {
    assert_eq!(&file[..4], b"ISOP");
    let [vertices, rows, pieces] = [16, 20, 24].map(|at| u32_at(file, at) as usize);
    let origin = [28, 32, 36].map(|at| f32_at(file, at));
    let (step_mm, row_mm) = (f32_at(file, 40), f32_at(file, 44));
    let first_piece = |row: usize| u32_at(file, 56 + 4 * row) as usize;
    let pieces_at = 60 + 4 * rows;
    let planes_at = pieces_at + 24 * pieces;
    let stored = |at: usize| u16::from_le_bytes([file[at], file[at + 1]]);
    let sum = |axis: usize, row: usize, vertex: usize| {
        (0..=row).fold(0u16, |sum, row| {
            sum.wrapping_add(stored(
                planes_at + 2 * ((axis * rows + row) * vertices + vertex),
            ))
        })
    };
    let row = ((depth_mm / row_mm) as usize).min(rows - 2);
    let mix = |near: u16, far: u16, share: f32| {
        f32::from(near) + (f32::from(far) - f32::from(near)) * share
    };
    let at_vertex = |vertex: usize| {
        let share = (depth_mm - row as f32 * row_mm) / row_mm;
        let mut position =
            [0, 1, 2].map(|axis| mix(sum(axis, row, vertex), sum(axis, row + 1, vertex), share));
        for piece in first_piece(row)..first_piece(row + 1) {
            let at = pieces_at + 24 * piece;
            let [start, end] = [4, 8].map(|offset| f32_at(file, at + offset));
            if u32_at(file, at) as usize == vertex && depth_mm > start && depth_mm <= end {
                let share = (depth_mm - start) / (end - start);
                position = [0, 1, 2].map(|axis| {
                    mix(
                        stored(at + 12 + 2 * axis),
                        stored(at + 18 + 2 * axis),
                        share,
                    )
                });
            }
        }
        [0, 1, 2].map(|axis| origin[axis] + step_mm * position[axis])
    };
    (0..vertices).map(at_vertex).collect()
}

#[tokio::test]
async fn the_table_of_paths_gives_the_mesh_at_any_depth() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let table = server
        .get(&format!("{case}/mesh/paths?contours=9&points=8"))
        .await
        .body;
    for depth in [0.0, 3.3, 12.25, 31.9] {
        let address = format!("{case}/mesh?depth_mm={depth}&contours=9&points=8");
        let mesh = server.get(&address).await.positions();
        let own = shrunk_by_client(&table, depth);
        for (own, mesh) in own.iter().zip(&mesh) {
            assert!(
                (0..3).all(|axis| (own[axis] - mesh[axis]).abs() < 1e-3),
                "{own:?} {mesh:?}"
            );
        }
    }
}

#[tokio::test]
async fn textures_say_how_to_read_them() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let facts = server.get(&case).await.json();
    for (route, format, greatest) in [
        ("volume", "u16", facts["intensity"]["max"].as_f64().unwrap()),
        ("distance", "i16", facts["max_depth_mm"].as_f64().unwrap()),
    ] {
        let texture = server.get(&format!("{case}/{route}")).await;
        let size = texture.header("x-isocortex-size").split(',');
        let voxels: usize = size.map(|side| side.parse::<usize>().unwrap()).product();
        assert_eq!(texture.body.len(), 2 * voxels, "{route}");
        assert_eq!(texture.header("x-isocortex-format"), format);
        assert_eq!(
            texture
                .header("x-isocortex-patient-from-voxel")
                .split(',')
                .count(),
            12
        );
        let [scale, offset] = ["scale", "offset"].map(|name| {
            texture
                .header(&format!("x-isocortex-{name}"))
                .parse::<f64>()
                .unwrap()
        });
        let stored = texture.body.chunks_exact(2).map(|pair| {
            let pair = [pair[0], pair[1]];
            if format == "u16" {
                f64::from(u16::from_le_bytes(pair))
            } else {
                f64::from(i16::from_le_bytes(pair))
            }
        });
        let read = stored
            .map(|value| scale * value + offset)
            .fold(f64::MIN, f64::max);
        assert!(
            (read - greatest).abs() < 0.02 * greatest,
            "{route}: {read} and {greatest}"
        );
    }
}

#[tokio::test]
async fn slices_and_the_whole_volume_show_what_lies_beyond_the_envelope() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let facts = server.get(&case).await.json();
    let cropped = server.get(&format!("{case}/volume")).await;
    let whole = server.get(&format!("{case}/volume?extent=whole")).await;
    let size = numbers(&whole, "x-isocortex-size");
    let acquired = facts["volume"]["size"].as_array().unwrap();
    let acquired: Vec<_> = acquired.iter().map(|side| side.as_f64().unwrap()).collect();
    assert_eq!(size, acquired);
    assert!(whole.body.len() > cropped.body.len());
    let quick = format!("{case}/volume?extent=whole&bits=8");
    assert_eq!(2 * server.get(&quick).await.body.len(), whole.body.len());
    // Up to the first and the last column of the volume there is air, which is white here; beyond them, nothing.
    let origin = numbers(&whole, "x-isocortex-patient-from-voxel");
    for (column, shows) in [(0.0, true), (size[0] - 1.0, true), (size[0], false)] {
        let position_mm = origin[3] + column * origin[0];
        let query = format!("position_mm={position_mm}&colormap=inverted&width=64&height=64");
        let slice = server.get(&format!("{case}/slices/sagittal?{query}")).await;
        let lit = slice.grey().pixels().filter(|pixel| pixel.0[0] > 0).count();
        assert_eq!(lit > 100, shows, "{position_mm} mm: {lit} pixels");
    }
}

/// A header's numbers.
fn numbers(answer: &Answer, name: &str) -> Vec<f64> {
    let parts = answer.header(name).split(',').map(str::parse);
    parts.collect::<Result<_, _>>().unwrap()
}

#[tokio::test]
async fn the_volume_in_eight_bits_is_that_of_sixteen_within_half_a_step() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let facts = server.get(&case).await.json();
    let whole = server.get(&format!("{case}/volume")).await;
    let quick = server.get(&format!("{case}/volume?bits=8")).await;
    assert_eq!(quick.header("x-isocortex-format"), "u8");
    for name in ["x-isocortex-size", "x-isocortex-patient-from-voxel"] {
        assert_eq!(quick.header(name), whole.header(name));
    }
    assert_eq!(2 * quick.body.len(), whole.body.len());
    let value = |answer: &Answer, stored: f64| {
        let [scale, offset] =
            ["scale", "offset"].map(|name| numbers(answer, &format!("x-isocortex-{name}"))[0]);
        scale * stored + offset
    };
    let window = &facts["intensity"]["window"];
    let [center, width] = ["center", "width"].map(|name| window[name].as_f64().unwrap());
    let ends = [0.0, 255.0].map(|stored| value(&quick, stored));
    let range = |name: &str| facts["intensity"][name].as_f64().unwrap();
    let wanted = [
        (center - width / 2.0).max(range("min")),
        (center + width / 2.0).min(range("max")),
    ];
    // Scale and offset are in single precision.
    let slack = 1e-4 * width;
    assert!(
        ends[0] <= wanted[0] + slack && ends[1] >= wanted[1] - slack,
        "{ends:?} do not hold {wanted:?}"
    );
    let half_a_step = 0.501 * (ends[1] - ends[0]) / 255.0;
    for (pair, &stored) in whole.body.chunks_exact(2).zip(&quick.body) {
        let acquired = value(&whole, f64::from(u16::from_le_bytes([pair[0], pair[1]])));
        let off = value(&quick, f64::from(stored)) - acquired.clamp(ends[0], ends[1]);
        assert!(off.abs() <= half_a_step, "{acquired} is off by {off}");
    }
}

#[tokio::test]
async fn coarse_depths_are_depths_of_the_whole_map() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let whole = server.get(&format!("{case}/distance")).await;
    let coarse = server.get(&format!("{case}/distance?step=4")).await;
    let size = |answer: &Answer| -> Vec<usize> {
        numbers(answer, "x-isocortex-size")
            .into_iter()
            .map(|side| side as usize)
            .collect()
    };
    let ([nx, ny, nz], [cx, cy, cz]) = (
        <[usize; 3]>::try_from(size(&whole)).unwrap(),
        <[usize; 3]>::try_from(size(&coarse)).unwrap(),
    );
    assert_eq!([cx, cy, cz], [nx, ny, nz].map(|side| side.div_ceil(4)));
    let depth =
        |answer: &Answer, index: usize| [answer.body[2 * index], answer.body[2 * index + 1]];
    for index in 0..cx * cy * cz {
        let [x, y, z] = [index % cx, index / cx % cy, index / (cx * cy)].map(|place| 4 * place);
        assert_eq!(depth(&coarse, index), depth(&whole, x + nx * (y + ny * z)));
    }
    let [fine, wide] =
        [&whole, &coarse].map(|answer| numbers(answer, "x-isocortex-patient-from-voxel"));
    for (place, (fine, wide)) in fine.into_iter().zip(wide).enumerate() {
        let factor = if place % 4 == 3 { 1.0 } else { 4.0 };
        assert_eq!(factor * fine, wide);
    }
}

#[tokio::test]
async fn pictures_show_the_brain_and_name_their_renderer() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for view in [
        "left",
        "right",
        "anterior",
        "posterior",
        "superior",
        "inferior",
    ] {
        let answer = server
            .get(&format!(
                "{case}/render?depth_mm=8&view={view}&width=96&height=64"
            ))
            .await;
        assert_eq!(answer.header("x-isocortex-renderer"), "trace");
        assert_eq!(answer.header("content-type"), "image/png");
        let picture = answer.grey();
        assert_eq!(picture.dimensions(), (96, 64));
        let lit = picture.pixels().filter(|pixel| pixel.0[0] > 20).count();
        assert!(lit > 250, "{view}: {lit} pixels");
    }
    for plane in ["axial", "coronal", "sagittal"] {
        let answer = server
            .get(&format!(
                "{case}/slices/{plane}?depth_mm=5,10&width=64&height=64"
            ))
            .await;
        let lit = answer
            .grey()
            .pixels()
            .filter(|pixel| pixel.0[0] > 20)
            .count();
        assert!(lit > 400, "{plane}: {lit} pixels");
    }
    let none = server.get(&format!("{case}/slices/diagonal")).await;
    assert_eq!(none.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn the_service_says_what_it_is_and_counts() {
    let server = Server::start().await;
    assert_eq!(server.get("/readyz").await.json()["status"], "ok");
    assert_eq!(server.get("/version").await.json()["name"], "isocortex");
    server.upload(&[("volume", &plain_head().bytes())]).await;
    let metrics = server.get("/metrics").await;
    let text = String::from_utf8(metrics.body.to_vec()).unwrap();
    assert!(
        text.contains(
            "isocortex_http_requests_total{method=\"POST\",route=\"/v1/cases\",status=\"202\"} 1"
        ),
        "{text}"
    );
    assert!(text.ends_with("# EOF\n"));
}
