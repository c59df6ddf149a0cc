//! The four languages that a sky is written in, and a writer for what they have in common: constants, tables,
//! functions, local variables and counted loops. Expressions are the same text in all four languages: scalars, and
//! triples whose parts are `.x`, `.y` and `.z`.

use crate::ExportFormat;

/// A language that a sky's functions are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceLanguage {
    Wgsl,
    Glsl,
    Hlsl,
    C,
}

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueType {
    /// A number; in C it is `MESOPHYLL_SKY_REAL`.
    Real,
    /// A number that is of double precision where the language has it.
    Wide,
    Whole,
    Truth,
    /// Three numbers: a colour, a direction, or the values of Y, x and y.
    Triple,
    /// All that depends on the sky and not on the direction.
    State,
}

impl SourceLanguage {
    /// The language of a format, where the format is one.
    pub fn of(format: ExportFormat) -> Option<SourceLanguage> {
        match format {
            ExportFormat::Wgsl => Some(SourceLanguage::Wgsl),
            ExportFormat::Glsl => Some(SourceLanguage::Glsl),
            ExportFormat::Hlsl => Some(SourceLanguage::Hlsl),
            ExportFormat::C => Some(SourceLanguage::C),
            _ => None,
        }
    }

    pub fn is_shader(self) -> bool {
        self != SourceLanguage::C
    }

    fn name_of(self, kind: ValueType) -> &'static str {
        use SourceLanguage::{C, Glsl, Hlsl, Wgsl};
        match (kind, self) {
            (ValueType::Real | ValueType::Wide, Wgsl) => "f32",
            (ValueType::Real | ValueType::Wide, Glsl | Hlsl) => "float",
            (ValueType::Real, C) => "MESOPHYLL_SKY_REAL",
            (ValueType::Wide, C) => "double",
            (ValueType::Whole, Wgsl) => "i32",
            (ValueType::Whole, _) | (ValueType::Truth, C) => "int",
            (ValueType::Truth, _) => "bool",
            (ValueType::Triple, Wgsl) => "vec3<f32>",
            (ValueType::Triple, Glsl) => "vec3",
            (ValueType::Triple, Hlsl) => "float3",
            (ValueType::Triple, C) => "mesophyll_sky_triple",
            (ValueType::State, C) => "mesophyll_sky_state",
            (ValueType::State, _) => "SkyState",
        }
    }

    /// A number, in single precision where the language has no other.
    pub fn number(self, v: f64) -> String {
        if self.is_shader() { format!("{:e}", v as f32) } else { format!("{v:?}") }
    }

    pub fn triple(self, v: [&str; 3]) -> String {
        let inner = v.join(", ");
        match self {
            SourceLanguage::C => format!("(mesophyll_sky_triple){{{inner}}}"),
            _ => format!("{}({inner})", self.name_of(ValueType::Triple)),
        }
    }
}

/// What a C header needs before anything else.
const OPENING: &str = "#ifndef MESOPHYLL_SKY_H
#define MESOPHYLL_SKY_H

#include <math.h>

// float or double: what the sums are formed and handed back in.
#ifndef MESOPHYLL_SKY_REAL
#define MESOPHYLL_SKY_REAL float
#endif

// A direction, or linear sRGB.
typedef struct {
    MESOPHYLL_SKY_REAL x, y, z;
} mesophyll_sky_triple;

static inline void mesophyll_sky_add(mesophyll_sky_triple *sum, MESOPHYLL_SKY_REAL by, mesophyll_sky_triple v) {
    sum->x += by * v.x;
    sum->y += by * v.y;
    sum->z += by * v.z;
}

";

/// A text that grows. Names begin with `sky_` and `SKY_`; in C with `mesophyll_sky_` and `MESOPHYLL_SKY_`.
pub struct SourceText {
    pub language: SourceLanguage,
    text: String,
    depth: usize,
}

impl SourceText {
    /// Begins with these lines as a comment.
    pub fn new(language: SourceLanguage, about: &[String]) -> SourceText {
        let mut out = SourceText { language, text: String::new(), depth: 0 };
        about.iter().for_each(|line| out.says(line));
        out.text.push('\n');
        if language == SourceLanguage::C {
            out.text.push_str(OPENING);
        }
        out
    }

    pub fn finish(mut self) -> String {
        if self.language == SourceLanguage::C {
            self.text.push_str("#endif\n");
        }
        self.text
    }

    pub fn number(&self, v: f64) -> String {
        self.language.number(v)
    }

    /// A comment.
    pub fn says(&mut self, what: &str) {
        self.line(format!("// {what}").trim_end());
    }

    pub fn line(&mut self, line: &str) {
        self.text.push_str(&"    ".repeat(self.depth));
        self.text.push_str(&self.named(line));
        self.text.push('\n');
    }

    pub fn gap(&mut self) {
        self.text.push('\n');
    }

    /// The names of C have the program's own name before them, for C has no other way to keep them apart.
    fn named(&self, line: &str) -> String {
        if self.language.is_shader() || line.starts_with('#') {
            return line.to_string();
        }
        let mut out = String::new();
        for (k, part) in line.split("sky_").enumerate() {
            let bare = k > 0 && !out.ends_with(|c: char| c.is_alphanumeric() || c == '_');
            out.push_str(match (k, bare) {
                (0, _) => "",
                (_, true) => "mesophyll_sky_",
                (_, false) => "sky_",
            });
            out.push_str(part);
        }
        let split: Vec<&str> = out.split("SKY_").collect();
        split.iter().skip(1).fold(split[0].to_string(), |text, part| {
            let own = text.ends_with("MESOPHYLL_");
            text + if own { "SKY_" } else { "MESOPHYLL_SKY_" } + part
        })
    }

    /// A constant; in C one that may be defined before the file is included.
    pub fn constant(&mut self, kind: ValueType, name: &str, value: &str) {
        let of = self.language.name_of(kind);
        match self.language {
            SourceLanguage::Wgsl => self.line(&format!("const {name}: {of} = {value};")),
            SourceLanguage::Glsl => self.line(&format!("const {of} {name} = {value};")),
            SourceLanguage::Hlsl => self.line(&format!("static const {of} {name} = {value};")),
            SourceLanguage::C => {
                self.text.push_str(&format!("#ifndef MESOPHYLL_{name}\n#define MESOPHYLL_{name} {value}\n#endif\n"));
            }
        }
    }

    /// A constant table of these lines of values.
    fn table(&mut self, kind: ValueType, name: &str, count: usize, lines: &[String]) {
        let of = self.language.name_of(kind);
        let (open, close) = match self.language {
            SourceLanguage::Wgsl => (format!("const {name}: array<{of}, {count}> = array<{of}, {count}>("), ");"),
            SourceLanguage::Glsl => (format!("const {of} {name}[{count}] = {of}[{count}]("), ");"),
            SourceLanguage::Hlsl => (format!("static const {of} {name}[{count}] = {{"), "};"),
            // What is read from a file of single precision takes no more room in C.
            SourceLanguage::C if kind == ValueType::Real => (format!("static const float {name}[{count}] = {{"), "};"),
            SourceLanguage::C => (format!("static const {of} {name}[{count}] = {{"), "};"),
        };
        self.line(&open);
        for (k, line) in lines.iter().enumerate() {
            // No comma after the last value: not every language allows one.
            self.line(&format!("    {line}{}", if k + 1 < lines.len() { "," } else { "" }));
        }
        self.line(close);
    }

    pub fn wholes(&mut self, name: &str, values: &[usize]) {
        let all: Vec<String> = values.iter().map(|v| v.to_string()).collect();
        let lines: Vec<String> = all.chunks(20).map(|row| row.join(", ")).collect();
        self.table(ValueType::Whole, name, values.len(), &lines);
    }

    /// Numbers of single precision. Reading them gives exactly the same numbers.
    pub fn singles(&mut self, name: &str, values: &[f32]) {
        let suffix = if self.language.is_shader() { "" } else { "f" };
        let all: Vec<String> = values.iter().map(|v| format!("{v:e}{suffix}")).collect();
        let lines: Vec<String> = all.chunks(8).map(|row| row.join(", ")).collect();
        self.table(ValueType::Real, name, values.len(), &lines);
    }

    /// Numbers of the precision that the language works with.
    pub fn wides(&mut self, name: &str, values: &[f64], each: usize) {
        let all: Vec<String> = values.iter().map(|v| self.number(*v)).collect();
        let lines: Vec<String> = all.chunks(each).map(|row| row.join(", ")).collect();
        self.table(ValueType::Wide, name, values.len(), &lines);
    }

    pub fn triples(&mut self, name: &str, values: &[[f64; 3]]) {
        let lines: Vec<String> = values
            .iter()
            .map(|v| {
                let [a, b, c] = v.map(|x| self.number(x));
                match self.language {
                    SourceLanguage::C => format!("{{{a}, {b}, {c}}}"),
                    language => language.triple([&a, &b, &c]),
                }
            })
            .collect();
        self.table(ValueType::Triple, name, values.len(), &lines);
    }

    /// The type of the state, from its fields; a count makes a field a list.
    pub fn state(&mut self, fields: &[(ValueType, &str, usize, &str)]) {
        let of = self.language.name_of(ValueType::State);
        let c = self.language == SourceLanguage::C;
        self.line(&if c { "typedef struct {".to_string() } else { format!("struct {of} {{") });
        self.depth = 1;
        for (kind, name, count, what) in fields {
            self.says(what);
            let kind = self.language.name_of(*kind);
            self.line(&match (self.language, count) {
                (SourceLanguage::Wgsl, 0) => format!("{name}: {kind},"),
                (SourceLanguage::Wgsl, n) => format!("{name}: array<{kind}, {n}>,"),
                (_, 0) => format!("{kind} {name};"),
                (_, n) => format!("{kind} {name}[{n}];"),
            });
        }
        self.depth = 0;
        self.text.push_str(&match self.language {
            SourceLanguage::Wgsl => "}\n\n".to_string(),
            SourceLanguage::C => format!("}} {of};\n\n"),
            _ => "};\n\n".to_string(),
        });
    }

    /// Opens a function.
    pub fn function(&mut self, gives: ValueType, name: &str, takes: &[(ValueType, &str)]) {
        let of = |kind| self.language.name_of(kind);
        let one = |(kind, name): &(ValueType, &str)| match (self.language, kind) {
            (SourceLanguage::Wgsl, _) => format!("{name}: {}", of(*kind)),
            (SourceLanguage::C, ValueType::State) => format!("const {} *{name}", of(*kind)),
            _ => format!("{} {name}", of(*kind)),
        };
        let inside = takes.iter().map(one).collect::<Vec<_>>().join(", ");
        let gives = of(gives);
        self.line(&match self.language {
            SourceLanguage::Wgsl => format!("fn {name}({inside}) -> {gives} {{"),
            SourceLanguage::C => {
                let inside = if takes.is_empty() { "void" } else { &inside };
                format!("static inline {gives} {name}({inside}) {{")
            }
            _ => format!("{gives} {name}({inside}) {{"),
        });
        self.depth = 1;
    }

    /// Closes a function.
    pub fn end(&mut self) {
        self.depth = 0;
        self.line("}");
        self.gap();
    }

    /// A local value that does not change.
    pub fn keep(&mut self, kind: ValueType, name: &str, value: &str) {
        let of = self.language.name_of(kind);
        self.line(&match self.language {
            SourceLanguage::Wgsl => format!("let {name}: {of} = {value};"),
            SourceLanguage::C => format!("const {of} {name} = {value};"),
            _ => format!("{of} {name} = {value};"),
        });
    }

    /// A local value that changes.
    pub fn var(&mut self, kind: ValueType, name: &str, value: &str) {
        let of = self.language.name_of(kind);
        self.line(&match self.language {
            SourceLanguage::Wgsl => format!("var {name}: {of} = {value};"),
            _ => format!("{of} {name} = {value};"),
        });
    }

    /// A local list, or a single value for `count` 0, without values yet.
    pub fn room(&mut self, kind: ValueType, name: &str, count: usize) {
        let of = self.language.name_of(kind);
        self.line(&match (self.language, count) {
            (SourceLanguage::Wgsl, 0) => format!("var {name}: {of};"),
            (SourceLanguage::Wgsl, n) => format!("var {name}: array<{of}, {n}>;"),
            (_, 0) => format!("{of} {name};"),
            (_, n) => format!("{of} {name}[{n}];"),
        });
    }

    /// Adds a multiple of a triple to a triple. C has no operators for it.
    pub fn add(&mut self, to: &str, by: &str, triple: &str) {
        self.line(&match self.language {
            SourceLanguage::C => format!("sky_add(&{to}, {by}, {triple});"),
            _ => format!("{to} += {by} * {triple};"),
        });
    }

    /// Opens a loop over `name` from `from` to less than `to`.
    pub fn each(&mut self, name: &str, from: &str, to: &str) {
        self.line(&match self.language {
            SourceLanguage::Wgsl => format!("for (var {name}: i32 = {from}; {name} < {to}; {name}++) {{"),
            _ => format!("for (int {name} = {from}; {name} < {to}; {name}++) {{"),
        });
        self.depth += 1;
    }

    /// Opens a block for a condition.
    pub fn when(&mut self, condition: &str) {
        self.line(&format!("if ({condition}) {{"));
        self.depth += 1;
    }

    /// Closes a loop or a block.
    pub fn close(&mut self) {
        self.depth -= 1;
        self.line("}");
    }
}
