//! Draws the left side of a head at four depths, beside each other.
//!
//! `cargo run -p isocortex-render --example views OUT.png`

use std::error::Error;

use geometry::{BrainMask, DeformableModel, envelope, phantom};
use render::{
    FrameSize, PixelFormat, RenderParameters, RenderRequest, Scene, SheetPlan, Window, draw_trace,
    encode_png,
};

const DEPTHS_MM: [f64; 4] = [0.0, 4.0, 8.0, 12.0];

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1).ok_or("usage: views OUT.png")?;
    let head = phantom::head(1.5);
    let brain = BrainMask::from_mask(&head.brain, head.volume.grid())?;
    let envelope = envelope(&brain, 10.0)?;
    let volume = DeformableModel::crop(&head.volume, &envelope).ok_or("there is no brain")?;
    let model = phantom::model(volume, envelope).model;

    let [dark, bright] = model.volume().percentiles([0.02, 0.98]).map(f64::from);
    let window = Window::new((dark + bright) / 2.0, bright - dark)?;
    let size = FrameSize::new(256, 256)?;
    let columns = DEPTHS_MM.map(|depth_mm| format!("{depth_mm} mm"));
    let plan = SheetPlan::new(size, vec!["left".to_owned()], columns.into())?;
    let mut sheet = plan.begin(PixelFormat::Grey8);
    for (column, depth_mm) in DEPTHS_MM.into_iter().enumerate() {
        let parameters = RenderParameters {
            depth_mm,
            size,
            ..RenderParameters::new(window)
        };
        let request = RenderRequest::new(parameters)?;
        let drawn = draw_trace(&Scene::from(&model), &request, &|| true);
        sheet.put(&drawn.ok_or("it stays wanted")?, 0, column);
    }
    std::fs::write(&file, encode_png(&sheet.finish(), &[])?)?;
    println!("{file}");
    Ok(())
}
