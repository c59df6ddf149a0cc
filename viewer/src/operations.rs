//! Counts the operations of a fragment shader in its intermediate representation. Calls are followed, both arms of
//! every branch count, and a loop counts once. The figure is for comparing shaders and is the same on every adapter. It
//! is not a time.

use wgpu::naga::{self, Block, Function, Module, Statement};

/// Operations from the entry point `fragment`; `None` where the source is no shader with one.
pub(crate) fn count(source: &str) -> Option<usize> {
    let module = naga::front::wgsl::parse_str(source).ok()?;
    let entry = module.entry_points.iter().find(|e| e.name == "fragment")?;
    Some(of_function(&module, &entry.function))
}

fn of_function(module: &Module, function: &Function) -> usize {
    of_block(module, &function.body)
}

fn of_block(module: &Module, block: &Block) -> usize {
    block
        .iter()
        .map(|statement| match statement {
            Statement::Emit(range) => range.clone().count(),
            Statement::Block(inner) => of_block(module, inner),
            Statement::If { accept, reject, .. } => 1 + of_block(module, accept) + of_block(module, reject),
            Statement::Switch { cases, .. } => 1 + cases.iter().map(|c| of_block(module, &c.body)).sum::<usize>(),
            Statement::Loop { body, continuing, .. } => 1 + of_block(module, body) + of_block(module, continuing),
            Statement::Call { function, .. } => of_function(module, &module.functions[*function]),
            _ => 1,
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calls_and_branches_are_followed() {
        let shader = |body: &str| {
            format!(
                "fn twice(x: f32) -> f32 {{ return x + x; }}\n@fragment fn fragment(@location(0) a: f32) -> \
                 @location(0) vec4f {{ {body} }}"
            )
        };
        let one = count(&shader("return vec4f(twice(a));")).expect("one call");
        let two = count(&shader("return vec4f(twice(a) + twice(a));")).expect("two calls");
        // The difference is another addition and another call.
        assert!(two > one + 1, "{one} {two}");
        let branch = count(&shader("if (a > 0.0) { return vec4f(twice(a)); } return vec4f(a);")).expect("a branch");
        assert!(branch > one);
        assert_eq!(count("fn"), None);
        assert_eq!(count("fn other() {}"), None);
    }
}
