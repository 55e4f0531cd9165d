//! The names of a translated shader's variables, and where the fields of its blocks are.

use std::collections::BTreeMap;
use std::fmt::Write;

use naga::{Module, StructMember, TypeInner};
use render::gpu::PAGE_SHADERS;

use crate::translate::{Translated, validated};

/// The listing of names and offsets for the page.
pub(crate) fn listing(translated: &[(&str, Translated)]) -> String {
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
    for (name, file, comma) in [
        ("Picture", "shrink.vert.glsl", ","),
        ("Paths", "shrink.vert.glsl", ","),
        ("Contours", "slice.frag.glsl", ""),
    ] {
        let module = module_of(file);
        let (members, bytes) = fields(&module, name);
        let fields = members.iter().map(|member| {
            let name = member.name.as_deref().unwrap_or_default();
            format!("        {name:?}: {}", member.offset)
        });
        let fields: Vec<_> = fields.collect();
        let _ = writeln!(
            json,
            "    {name:?}: {{\n      \"bytes\": {bytes},\n      \"offsets\": {{\n{}\n      }}\n    }}{comma}",
            fields.join(",\n")
        );
    }
    json.push_str("  }\n}\n");
    json
}

/// The module of one of the page's shaders.
pub(crate) fn module_of(file: &str) -> Module {
    let mut shaders = PAGE_SHADERS.iter();
    let found = shaders.find(|shader| shader.file == file);
    validated(found.expect("the page has this shader").source).0
}

/// The fields of a struct, and its size in bytes.
pub(crate) fn fields<'a>(module: &'a Module, name: &str) -> (&'a [StructMember], u32) {
    let mut types = module.types.iter();
    match types.find(|(_, found)| found.name.as_deref() == Some(name)) {
        Some((_, found)) => match &found.inner {
            TypeInner::Struct { members, span } => (members, *span),
            _ => panic!("{name} is no struct of the shaders"),
        },
        None => panic!("the shaders have no {name}"),
    }
}
