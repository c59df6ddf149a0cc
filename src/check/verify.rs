//! Whether the fits that a scene uses are still as they were fitted: their content hashes, and whether their numbers
//! agree with each other and with the blade.

use crate::consistency;
use mesophyll_error::Result;
use mesophyll_fit::consistency::Faults;
use mesophyll_placed::ledger::Ledger;
use mesophyll_scene::loaded::Scene;

/// What the fits of a scene say against themselves: fits of leaves, of translucency maps, of branches and of lawns.
///
/// # Errors
/// [`mesophyll_error::Error::Input`] for a file that cannot be read.
pub fn verify(scene: &Scene, ledger: &Ledger) -> Result<Faults> {
    let mut faults = scene.faults(ledger)?;
    for leaf in scene.leaves() {
        faults.contradictions.extend(consistency::contradictions(leaf, ledger)?);
    }
    Ok(faults)
}
