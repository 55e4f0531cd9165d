//! The twins of the shaders' blocks in the renderer.

use naga::{ArraySize, Handle, Module, Scalar, ScalarKind, Type, TypeInner, VectorSize};

use crate::names::{fields, module_of};

/// `layout.rs` of the renderer: structs that lie in memory as the blocks `Picture` and `Paths` do.
pub(crate) fn twins() -> String {
    let module = module_of("shrink.vert.glsl");
    let picture = twin(&module, "Picture", "picture.wgsl", "");
    let paths = twin(&module, "Paths", "shrink.wgsl", "#[cfg(test)]\n");
    format!(
        "//! The Rust twins of the shaders' structs, which `cargo run -p shader-translate` writes.\n\nuse bytemuck::{{Pod, Zeroable}};\n\n{picture}\n{paths}"
    )
}

fn twin(module: &Module, name: &str, file: &str, condition: &str) -> String {
    let mut text = format!(
        "/// Twin of `{name}` in `{file}`, which describes each field. Matrices are column by column.\n{condition}#[repr(C)]\n#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]\npub(super) struct {name} {{\n"
    );
    let (members, span) = fields(module, name);
    let mut paddings = 0;
    let ends = members[1..]
        .iter()
        .map(|member| member.offset)
        .chain([span]);
    for (member, end) in members.iter().zip(ends) {
        let field = member.name.as_deref().unwrap_or_default();
        text += &format!("    pub(super) {field}: {},\n", of_rust(module, member.ty));
        let gap = end - member.offset - module.types[member.ty].inner.size(module.to_ctx());
        if gap > 0 {
            text += &format!("    pub(super) _padding_{paddings}: [u32; {}],\n", gap / 4);
            paddings += 1;
        }
    }
    text + "}\n"
}

/// The type in Rust, of the same size.
fn of_rust(module: &Module, ty: Handle<Type>) -> String {
    let scalar = |scalar: Scalar| match scalar.kind {
        ScalarKind::Float => "f32",
        ScalarKind::Uint => "u32",
        kind => panic!("no block has a {kind:?}"),
    };
    match module.types[ty].inner {
        TypeInner::Scalar(kind) => scalar(kind).to_owned(),
        TypeInner::Vector { size, scalar: kind } => format!("[{}; {}]", scalar(kind), size as u8),
        TypeInner::Matrix {
            columns,
            rows: VectorSize::Quad,
            scalar: kind,
        } => format!("[[{}; 4]; {}]", scalar(kind), columns as u8),
        TypeInner::Array {
            base,
            size: ArraySize::Constant(count),
            stride: 16,
        } => format!("[{}; {count}]", of_rust(module, base)),
        ref other => panic!("no block has a {other:?}"),
    }
}
