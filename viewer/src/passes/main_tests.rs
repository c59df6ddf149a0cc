use super::*;
use crate::scene::Sides;
use crate::variant::{LeafSurface, Lights, SideVariant, Surface};

fn lit(surface: Surface) -> Variant {
    let lights = Lights { sun: true, sky: true, ..Lights::default() };
    Variant {
        lights,
        surface,
        msaa: 4,
        levels: false,
        bend: None,
        turn: false,
        stand: false,
        anchored: None,
        shares: false,
    }
}

fn lines(v: &Variant) -> Vec<String> {
    let own = |l: &&str| !l.trim().is_empty() && !l.trim().starts_with("//");
    source(v).lines().filter(own).map(str::to_string).collect()
}

/// Bark and ground are compiled without any of a leaf's code.
#[test]
fn an_opaque_shader_holds_no_leaf() {
    let leaf = |words: &[&str], v: &Variant| {
        let source = lines(v).join("\n");
        words.iter().filter(|w| source.contains(**w)).count()
    };
    let words = ["Place", "transmittance", "map_sampler", "texture_2d<f32>", "LeafConstants", "uv"];
    assert_eq!(leaf(&words, &lit(Surface::Leaf(LeafSurface::default()))), words.len());
    assert_eq!(leaf(&words, &lit(Surface::Opaque { pattern: false })), 0);
}

/// The bent basis changes one line and adds two before it. A shader without it contains none of them.
#[test]
fn straight_translucency_is_compiled_without_the_bent_ones_code() {
    let side = SideVariant { translucency: 1, ..SideVariant::default() };
    let of = |bent| lit(Surface::Leaf(LeafSurface { sides: Sides::of(|_| side), bent, ..LeafSurface::default() }));
    let (plain, bent) = (lines(&of(false)), lines(&of(true)));
    let lost: Vec<&String> = plain.iter().filter(|l| !bent.contains(l)).collect();
    let gained: Vec<&String> = bent.iter().filter(|l| !plain.contains(l)).collect();
    assert!(lost.len() == 1 && lost[0].trim().starts_with("let omega ="), "{lost:?}");
    assert!(gained.len() == 3 && plain.len() + 2 == bent.len(), "{gained:?}");
    assert_eq!(gained.iter().map(|l| l.matches("sqrt(").count()).sum::<usize>(), 2);
}
