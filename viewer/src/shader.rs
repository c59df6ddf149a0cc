//! Assembles the WGSL of a pass for what a scene needs. Lines between `//#if NAME` (or `!NAME`) and `//#endif` stay
//! only where the name is set. So the code, bindings and textures of an absent sun, sky or gloss do not exist.

use crate::scene::Side;

/// The names that are set, and the constants that are put in front of the source.
#[derive(Debug, Clone, Default)]
pub(crate) struct Defines {
    names: Vec<&'static str>,
    constants: Vec<(&'static str, u32)>,
}

impl Defines {
    pub(crate) fn set(mut self, name: &'static str, on: bool) -> Self {
        if on {
            self.names.push(name);
        }
        self
    }

    pub(crate) fn constant(mut self, name: &'static str, value: u32) -> Self {
        self.constants.push((name, value));
        self
    }

    fn holds(&self, condition: &str) -> bool {
        condition.split("||").map(str::trim).any(|name| match name.strip_prefix('!') {
            Some(name) => !self.names.contains(&name),
            None => self.names.contains(&name),
        })
    }
}

/// Makes one side's source from source that is written once for both sides: see `passes/side.wgsl`.
pub(crate) fn of_side(source: &str, side: Side) -> String {
    let (number, minus) = match side {
        Side::Front => ("1", ""),
        Side::Back => ("2", "-"),
    };
    source.replace("$side", side.name()).replace("$n", number).replace("$-", minus)
}

/// Assembles `source`. Conditions may be nested, and `||` joins names.
pub(crate) fn assemble(source: &str, defines: &Defines) -> String {
    let mut out = String::with_capacity(source.len());
    for (name, value) in &defines.constants {
        out.push_str(&format!("const {name}: u32 = {value}u;\n"));
    }
    let mut open: Vec<bool> = Vec::new();
    for line in source.lines() {
        let word = line.trim();
        if let Some(condition) = word.strip_prefix("//#if ") {
            open.push(defines.holds(condition));
        } else if word == "//#else" {
            if let Some(last) = open.last_mut() {
                *last = !*last;
            }
        } else if word == "//#endif" {
            open.pop();
        } else if open.iter().all(|on| *on) {
            out.push_str(line);
            out.push('\n');
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_has_its_own_name_number_and_sign() {
        let source = "@binding($n0) var $side_map; $-x";
        assert_eq!(of_side(source, Side::Front), "@binding(10) var front_map; x");
        assert_eq!(of_side(source, Side::Back), "@binding(20) var back_map; -x");
    }

    #[test]
    fn only_what_is_set_stays() {
        let source = "a\n//#if SUN\nb\n//#if !SKY\nc\n//#else\nd\n//#endif\n//#endif\n//#if SUN || SKY\ne\n//#endif\n";
        let on = |names: &[&'static str]| names.iter().fold(Defines::default(), |d, n| d.set(n, true));
        assert_eq!(assemble(source, &on(&[])), "a\n");
        assert_eq!(assemble(source, &on(&["SUN"])), "a\nb\nc\ne\n");
        assert_eq!(assemble(source, &on(&["SUN", "SKY"])), "a\nb\nd\ne\n");
        assert_eq!(assemble("x", &Defines::default().constant("N", 3)), "const N: u32 = 3u;\nx\n");
    }
}
