//! One shader in the language of the page.

use std::collections::BTreeMap;

use naga::ShaderStage;
use naga::back::glsl;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use render::gpu::{PageShader, PageStage};

/// A shader in GLSL, and the names in it by those in WGSL.
pub(crate) struct Translated {
    pub(crate) text: String,
    pub(crate) names: BTreeMap<&'static str, BTreeMap<String, String>>,
}

/// Translates one stage. Clip space and rows of textures stay as they are: y up on the screen, the first row at 0.
pub(crate) fn translate(shader: &PageShader) -> Translated {
    let entry_point = shader.entry_point;
    let shader_stage = match shader.stage {
        PageStage::Vertex => ShaderStage::Vertex,
        PageStage::Fragment => ShaderStage::Fragment,
    };
    let (module, info) = validated(shader.source);
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

/// A shader's module and what naga found out about it.
pub(crate) fn validated(source: &str) -> (naga::Module, ModuleInfo) {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    (module, info)
}

#[cfg(test)]
mod tests {
    use render::gpu::PAGE_SHADERS;

    use super::translate;

    #[test]
    fn both_stages_of_a_program_agree_on_what_passes_between_them() {
        for (vertex, fragment) in [
            ("screen.vert.glsl", "reduce.frag.glsl"),
            ("screen.vert.glsl", "trace.frag.glsl"),
            ("screen.vert.glsl", "slice.frag.glsl"),
        ] {
            let [vertex, fragment] = [vertex, fragment].map(|file| {
                let mut shaders = PAGE_SHADERS.iter();
                let shader = shaders.find(|shader| shader.file == file);
                translate(shader.expect("the page has this shader")).text
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
}
