//! From the mask to a mesh at a depth.

use bench::counted::Counted;
use geometry::{
    BrainMask, DepthField, MeshSize, Paths, ShellIndex, core, distance_map, envelope,
    envelope_mesh, forest, path_table, shrink_once,
};

use crate::head::{case, head, step};

/// The number of depths per step.
const DEPTHS: usize = 1000;

const DEPTH_MM: f32 = 10.0;

pub(crate) fn steps() -> Vec<Counted> {
    let mut steps = preparation();
    steps.extend(meshes());
    steps
}

fn preparation() -> Vec<Counted> {
    vec![
        Counted {
            name: "geometry: mask to the working grid",
            make: || {
                let (volume, mask) = head().read().expect("a sound head");
                step(move || BrainMask::from_mask(&mask, volume.grid()))
            },
        },
        Counted {
            name: "geometry: closing by 10 mm",
            make: || {
                let (volume, mask) = head().read().expect("a sound head");
                let brain = BrainMask::from_mask(&mask, volume.grid()).expect("a brain");
                step(move || envelope(&brain, 10.0))
            },
        },
        Counted {
            name: "geometry: distance map",
            make: || {
                let case = case();
                step(move || distance_map(case.distance.envelope()))
            },
        },
        Counted {
            name: "geometry: core",
            make: || {
                let case = case();
                step(move || core(&case.distance))
            },
        },
        Counted {
            name: "geometry: forest",
            make: || {
                let case = case();
                let core = core(&case.distance);
                step(move || forest(&case.distance, &core))
            },
        },
        Counted {
            name: "geometry: depth field",
            make: || {
                let case = case();
                step(move || DepthField::new(&case.distance))
            },
        },
        Counted {
            name: "geometry: smoothed field",
            make: || {
                let case = case();
                step(move || case.model().field().smoothed(1.5))
            },
        },
        Counted {
            name: "geometry: shell index",
            make: || {
                let case = case();
                step(move || ShellIndex::new(&case.distance))
            },
        },
    ]
}

fn meshes() -> Vec<Counted> {
    const SIZE: MeshSize = MeshSize::STANDARD;
    vec![
        Counted {
            name: "geometry: envelope mesh, 1,800 triangles",
            make: || {
                let case = case();
                step(move || envelope_mesh(case.model().field(), SIZE))
            },
        },
        Counted {
            name: "geometry: table of paths, forest",
            make: || {
                let case = case();
                let (mesh, _) = case.table(SIZE).expect("a mesh");
                step(move || case.table_of(&mesh))
            },
        },
        Counted {
            name: "geometry: table of paths, flow",
            make: || {
                let case = case();
                let (mesh, _) = case.table(SIZE).expect("a mesh");
                step(move || path_table(&mesh, &case.distance, case.model().field(), Paths::Flow))
            },
        },
        Counted {
            name: "geometry: 1,000 new depths",
            make: || {
                let (_, table) = case().table(SIZE).expect("a mesh");
                let depth = |number: usize| 40.0 * number as f32 / DEPTHS as f32;
                step(move || {
                    for number in 0..DEPTHS {
                        std::hint::black_box(table.shrink(depth(number)));
                    }
                })
            },
        },
        Counted {
            name: "geometry: a depth without a table",
            make: || {
                let case = case();
                let (mesh, _) = case.table(SIZE).expect("a mesh");
                step(move || {
                    let paths = Paths::Forest(&case.forest);
                    shrink_once(&mesh, &case.distance, case.model().field(), paths, DEPTH_MM)
                })
            },
        },
    ]
}
