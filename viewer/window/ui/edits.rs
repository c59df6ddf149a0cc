//! Edits of leaves: the editor computes what a change of the slab means, and the picture shows it.

use super::ViewerUi;
use crate::editor::LeafEdit;
use mesophyll_viewer::scene::Sides;

impl ViewerUi {
    /// Applies an edit: the editor solves the slab again, and the picture shows the result. A refusal is shown, and the
    /// leaf stays unchanged.
    pub fn set_edit(&mut self, leaf: usize, edit: LeafEdit) {
        let Some(target) = self.scene.leaf_mut(leaf) else { return };
        let update = match self.editor.recompute(leaf, &edit) {
            Ok(update) => update,
            Err(reason) => {
                self.message = reason;
                return;
            }
        };
        let Sides { front, back } = update.sides;
        let own = Sides {
            front: std::mem::replace(&mut target.sides.front.interior, front),
            back: std::mem::replace(&mut target.sides.back.interior, back),
        };
        let thickness = std::mem::replace(&mut target.thickness_mm, update.thickness_mm);
        self.own_interiors.entry(leaf).or_insert((thickness, own));
        self.finish_edit(leaf, edit);
    }

    /// Restores a leaf as it was fitted, bit for bit.
    pub fn reset(&mut self, leaf: usize) {
        let (Some(target), Some((thickness, own))) = (self.scene.leaf_mut(leaf), self.own_interiors.remove(&leaf))
        else {
            return;
        };
        target.thickness_mm = thickness;
        (target.sides.front.interior, target.sides.back.interior) = (own.front, own.back);
        self.finish_edit(leaf, self.starts[&leaf]);
    }

    fn finish_edit(&mut self, leaf: usize, edit: LeafEdit) {
        self.message.clear();
        self.edits.insert(leaf, edit);
        let (Some(target), Some(own)) = (self.scene.leaf_mut(leaf), self.own_gloss.get(&leaf)) else { return };
        for (side, maps) in target.sides.iter_mut() {
            let factors = edit.sides[side];
            let scaled = |t: &[f32; 4]| {
                let s = factors.rho_s_scale;
                [t[0] * s, t[1] * s, t[2] * s, t[3] * factors.m_scale]
            };
            maps.gloss = own[side].as_ref().map(|texels| texels.iter().map(scaled).collect());
        }
        self.thumbnails.forget(leaf);
        self.leaves_changed.insert(leaf);
        self.make_stale();
        self.dirty = true;
    }

    pub(super) fn save(&mut self) {
        self.message = match self.editor.save(self.leaf, &self.edits[&self.leaf]) {
            Ok(place) => format!("saved: {place}"),
            Err(reason) => format!("not saved: {reason}"),
        };
    }

    pub(super) fn choose(&mut self, leaf: usize) {
        self.leaf = leaf;
        if self.alone {
            self.show_alone(true);
        }
    }

    pub(super) fn show_alone(&mut self, alone: bool) {
        self.alone = alone;
        self.scene.instances = match self.instances.iter().find(|i| i.material == self.leaf).filter(|_| alone) {
            Some(one) => vec![*one],
            None => self.instances.clone(),
        };
        // The light that arrives at a leaf between others does not arrive at it when it stands alone.
        self.scene.transfer = if alone { None } else { self.transfer.clone() };
        self.scene.sun_shares = if alone { None } else { self.sun_shares.clone() };
        self.scene_changed = true;
        self.make_stale();
        self.dirty = true;
    }

    pub(super) fn make_stale(&mut self) {
        if let Some(check) = &mut self.check {
            check.stale = true;
        }
    }
}
