//! What a reader must know about a leaf's maps before taking them for the parameters: which description of the leaf
//! they are, and what their intervals do not include.

use crate::maps::ReportSideMaps;
use crate::number::percent;
use mesophyll_fits::record::{FitKind, FitRecord, GAUGE_GAMMA, GAUGE_THICKNESS, RecordSection};

/// Adds the notes to the maps of a leaf scan's side; maps of other fits need none.
pub fn add(side: &mut ReportSideMaps, record: &FitRecord, section: &RecordSection) {
    // A dome fit inverts every texel by itself, so it has only one description.
    if record.kind != FitKind::Leaf || record.options.get("capture_kind").is_some_and(|k| k == "dome") {
        return;
    }
    let caliper = section
        .params
        .get("thickness")
        .and_then(|p| Some(p.stderr_caliper.first()? / p.value.first()?))
        .filter(|c| *c > 0.0);
    let together = caliper.map_or_else(String::new, |c| {
        format!(" The caliper's ± {} moves all texels together; it is not in these errors.", percent(c))
    });
    let compared = side.truth.as_ref().is_some_and(|t| t.get("sigma_a.G").is_some());
    let truth = if compared { " The truth beside them is the true leaf described in the same way." } else { "" };
    let pigment = format!(
        "These maps describe the leaf in another way than the parameters do. Here every texel has a σa and a σs of its \
         own, computed from its own ρd, ρt \
         and thickness, as if pigment alone made it differ from its neighbours. Among the parameters, one σa and one \
         σs hold for the whole leaf and a \
         factor γ a texel takes up the rest.{truth} The errors hold the noise of ρd, ρt and thickness, not the error \
         of the common fit.{together}"
    );
    for name in ["sigma_a", "sigma_s"] {
        side.notes.insert(name, pigment.clone());
    }
    let thickness = "Only σa × thickness and σs × thickness can be measured: the mean over the good texels is set to \
     the caliper's reading.";
    side.notes.insert("thickness", format!("{thickness}{together}"));
    let gamma = "A texel's reflectance over that of a slab with the leaf's σa and σs and the texel's thickness. The \
     mean over the good texels is set to 1.";
    side.notes.insert("gamma", gamma.into());
    if let Some(pass) = record.missing_pass() {
        let name = pass.name();
        let unseen = format!("Pass {name} was not taken, so the normals' {name} is undetermined: its map holds 0.");
        side.notes.insert("normal", unseen);
    }
    if let (Some(h), Some(g)) = (section.figures.get(GAUGE_THICKNESS), section.figures.get(GAUGE_GAMMA)) {
        side.unjudged = Some(format!(
            "over the good texels the true mean thickness is {} off the caliper's and the true mean γ {} off 1, and \
             stated errors do not hold that",
            percent(h.abs()),
            percent(g.abs())
        ));
    }
}
