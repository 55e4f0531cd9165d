//! The shaders in the language of the page, GLSL ES 3.00: kept in `web/shaders`, and never stale.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use naga::ShaderStage;
use naga::back::glsl;

use super::super::shaders;
use super::shaders::{layout, validated};
use crate::ColorMap;

/// Set to write the files anew.
const REWRITE: &str = "ISOCORTEX_WRITE_GLSL";

/// The page's files: name, source, stage, entry point.
const FILES: [(&str, &str, ShaderStage, &str); 5] = [
    (
        "mesh.vert.glsl",
        shaders::MESH,
        ShaderStage::Vertex,
        "mesh_vertex",
    ),
    (
        "shrink.vert.glsl",
        shaders::SHRINK,
        ShaderStage::Vertex,
        "shrunk_vertex",
    ),
    (
        "reduce.frag.glsl",
        shaders::REDUCE,
        ShaderStage::Fragment,
        "mesh_reduced",
    ),
    (
        "screen.vert.glsl",
        shaders::TRACE,
        ShaderStage::Vertex,
        "screen_vertex",
    ),
    (
        "trace.frag.glsl",
        shaders::TRACE,
        ShaderStage::Fragment,
        "trace_shaded",
    ),
];

/// A shader in GLSL, and the names in it by those in WGSL.
struct Translated {
    text: String,
    names: BTreeMap<&'static str, BTreeMap<String, String>>,
}

/// Translates one stage. Clip space and rows of textures stay as they are: y up on the screen, the first row at 0.
fn translate(source: &str, shader_stage: ShaderStage, entry_point: &str) -> Translated {
    let (module, info) = validated(source);
    let options = glsl::Options {
        version: glsl::Version::new_gles(300),
        writer_flags: glsl::WriterFlags::empty(),
        ..Default::default()
    };
    let pipeline = glsl::PipelineOptions {
        shader_stage,
        entry_point: entry_point.to_owned(),
        multiview: None,
    };
    let mut text = String::new();
    let policies = naga::proc::BoundsCheckPolicies::default();
    let mut writer = glsl::Writer::new(&mut text, &module, &info, &options, &pipeline, policies)
        .expect("the shader suits GLSL ES 3.00");
    let reflection = writer
        .write()
        .expect("the shader can be written as GLSL ES 3.00");
    let name = |variable: naga::Handle<naga::GlobalVariable>| {
        module.global_variables[variable]
            .name
            .clone()
            .unwrap_or_default()
    };
    let mut names = BTreeMap::new();
    let blocks = reflection.uniforms.iter();
    names.insert(
        "blocks",
        blocks
            .map(|(&variable, block)| (name(variable), block.clone()))
            .collect(),
    );
    let samplers = reflection.texture_mapping.iter();
    names.insert(
        "samplers",
        samplers
            .map(|(glsl, mapping)| (name(mapping.texture), glsl.clone()))
            .collect(),
    );
    let point = module
        .entry_points
        .iter()
        .find(|point| point.name == entry_point);
    let inputs = point
        .into_iter()
        .flat_map(|point| &point.function.arguments);
    let attributes = inputs.filter_map(|input| match &input.binding {
        Some(naga::Binding::Location { location, .. }) if shader_stage == ShaderStage::Vertex => {
            Some((input.name.clone()?, format!("_p2vs_location{location}")))
        }
        _ => None,
    });
    let attributes: BTreeMap<_, _> = attributes.collect();
    for attribute in attributes.values() {
        assert!(
            text.contains(attribute),
            "naga names attributes otherwise now"
        );
    }
    names.insert("attributes", attributes);
    if shader_stage == ShaderStage::Vertex {
        let outputs = outputs(&module, entry_point);
        assert!(outputs.values().all(|output| text.contains(output)));
        names.insert("outputs", outputs);
    }
    Translated { text, names }
}

/// What a vertex's entry point hands on, by the names of its members.
fn outputs(module: &naga::Module, entry_point: &str) -> BTreeMap<String, String> {
    let mut points = module.entry_points.iter();
    let point = points.find(|point| point.name == entry_point);
    let result = point.and_then(|point| point.function.result.as_ref());
    let members = match result.map(|result| &module.types[result.ty].inner) {
        Some(naga::TypeInner::Struct { members, .. }) => members.as_slice(),
        _ => &[],
    };
    let outputs = members.iter().filter_map(|member| match member.binding {
        Some(naga::Binding::Location { location, .. }) => {
            Some((member.name.clone()?, format!("_vs2fs_location{location}")))
        }
        _ => None,
    });
    outputs.collect()
}

/// The listing of names and offsets for the page.
fn listing(translated: &[(&str, Translated)]) -> String {
    let (module, _) = validated(shaders::SHRINK);
    let quoted = |pairs: &BTreeMap<String, String>| {
        let pairs = pairs
            .iter()
            .map(|(key, value)| format!("{key:?}: {value:?}"));
        pairs.collect::<Vec<_>>().join(", ")
    };
    let mut json = String::from("{\n  \"shaders\": {\n");
    for (place, (file, shader)) in translated.iter().enumerate() {
        let groups = shader.names.iter();
        let groups: Vec<_> = groups
            .map(|(group, names)| {
                format!("      {group:?}: {{ {} }}", quoted(names)).replace("{  }", "{}")
            })
            .collect();
        let comma = if place + 1 < translated.len() {
            ","
        } else {
            ""
        };
        let _ = writeln!(
            json,
            "    {file:?}: {{\n{}\n    }}{comma}",
            groups.join(",\n")
        );
    }
    json.push_str("  },\n  \"blocks\": {\n");
    for (name, comma) in [("Picture", ","), ("Paths", "")] {
        let (fields, bytes) = layout(&module, name);
        let fields: Vec<_> = fields
            .into_iter()
            .map(|(field, offset)| format!("        {field:?}: {offset}"))
            .collect();
        let _ = writeln!(
            json,
            "    {name:?}: {{\n      \"bytes\": {bytes},\n      \"offsets\": {{\n{}\n      }}\n    }}{comma}",
            fields.join(",\n")
        );
    }
    json.push_str("  }\n}\n");
    json
}

/// The colours of each map: 256 times red, then green, then blue, each as the difference from the one before it modulo 256, in
/// two hexadecimal digits. (Differences are small and compress well.)
fn colors() -> String {
    let rows = ColorMap::ALL.map(|map| {
        let table = map.table();
        let channels = (0..3).flat_map(|channel| table.map(|color| color[channel]));
        let mut before = 0_u8;
        let differences =
            channels.map(|share| share.wrapping_sub(std::mem::replace(&mut before, share)));
        let digits: String = differences.map(|share| format!("{share:02x}")).collect();
        format!("  {:?}: {digits:?}", map.name())
    });
    format!("{{\n{}\n}}\n", rows.join(",\n"))
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../web/shaders")
}

#[test]
fn the_page_draws_with_the_same_code() {
    let translated =
        FILES.map(|(file, source, stage, point)| (file, translate(source, stage, point)));
    let mut files = vec![
        ("names.json", listing(&translated)),
        ("colors.json", colors()),
    ];
    files.extend(
        translated
            .into_iter()
            .map(|(file, shader)| (file, shader.text)),
    );
    if std::env::var_os(REWRITE).is_some() {
        std::fs::create_dir_all(folder()).expect("the folder can be made");
        for (file, text) in &files {
            std::fs::write(folder().join(file), text).expect("the file can be written");
        }
    }
    for (file, text) in files {
        let kept = std::fs::read_to_string(folder().join(file)).unwrap_or_default();
        assert!(
            kept == text,
            "web/shaders/{file} is stale: run the tests of this crate once with {REWRITE}=1"
        );
    }
}

#[test]
fn both_stages_of_a_program_agree_on_what_passes_between_them() {
    for (vertex, fragment) in [(3, 2), (3, 4)] {
        let [vertex, fragment] = [vertex, fragment].map(|place| {
            let (_, source, stage, point) = FILES[place];
            translate(source, stage, point).text
        });
        let passed = |text: &str, keyword: &str| {
            let lines = text.lines().filter(|line| line.contains("_vs2fs_location"));
            let declared = lines.filter_map(|line| line.trim().split_once(keyword));
            declared
                .map(|(_, name)| name.to_owned())
                .collect::<Vec<_>>()
        };
        let [given, taken] = [passed(&vertex, "out "), passed(&fragment, "in ")];
        assert!(!given.is_empty());
        assert_eq!(given, taken);
    }
}
