//! Pictures.

use bench::Spin;
use bench::counted::Counted;
use geometry::MeshSize;
use render::{
    FrameSize, RenderBackend, SizedMesh, SliceParameters, SlicePlane, SliceRequest, draw_slice,
    encode_png,
};

use crate::head::{case, step};

/// A frame of 256 × 256 pixels at a depth.
fn spin(depth_mm: f32) -> Spin {
    Spin {
        frames: 1,
        seconds: 1.0,
        size: FrameSize::new(256, 256).expect("a small frame"),
        depth_mm,
    }
}

fn picture(backend: RenderBackend, depth_mm: f32) -> Box<dyn FnMut()> {
    let case = case();
    let request = spin(depth_mm).request(&case, 30).expect("a request");
    let job = case.job(request, None);
    step(move || backend.draw(&job))
}

/// The facets of 1,800 or more triangles, 15 mm deep.
fn facets(size: MeshSize) -> Box<dyn FnMut()> {
    let case = case();
    let (_, table) = case.table(size).expect("a mesh");
    let request = spin(15.0).request(&case, 30).expect("a request");
    let mesh = table.shrink(15.0);
    let job = case.job(request, Some(SizedMesh { size, mesh }));
    step(move || RenderBackend::Mesh.draw(&job))
}

pub(crate) fn steps() -> Vec<Counted> {
    vec![
        Counted {
            name: "render: splat 256², 0 mm",
            make: || picture(RenderBackend::Splat, 0.0),
        },
        Counted {
            name: "render: splat 256², 15 mm",
            make: || picture(RenderBackend::Splat, 15.0),
        },
        Counted {
            name: "render: mesh 256², 15 mm, 1,800 triangles",
            make: || facets(MeshSize::STANDARD),
        },
        Counted {
            name: "render: mesh 256², 15 mm, 20,000 triangles",
            make: || facets(MeshSize::new(100, 100).expect("a size")),
        },
        Counted {
            name: "render: trace 256², 15 mm",
            make: || picture(RenderBackend::Trace, 15.0),
        },
        Counted {
            name: "render: slice 512², three contours",
            make: || {
                let case = case();
                let middle_mm = SlicePlane::Axial.middle_mm(&case.model().bounds());
                let parameters = SliceParameters {
                    depths_mm: vec![5.0, 10.0, 20.0],
                    ..SliceParameters::new(SlicePlane::Axial, middle_mm, case.window)
                };
                let request = SliceRequest::new(parameters).expect("a request");
                step(move || draw_slice(&case.scene(), &request))
            },
        },
        Counted {
            name: "render: PNG of 256², grey",
            make: || {
                let case = case();
                let request = spin(5.0).request(&case, 30).expect("a request");
                let drawn = RenderBackend::Splat.draw(&case.job(request, None));
                let frame = drawn.expect("a frame").frame;
                step(move || encode_png(&frame, &[]))
            },
        },
    ]
}
