//! Edits: a slider makes one, the part of the scene that it is for takes it over, or the editor refuses it.

use super::{Change, ViewerUi};
use crate::edit::{Edit, EditGroup, EditQuantity, EditTarget, Edits};
use egui::{Color32, RichText, Slider, SliderClamping};
use mesophyll_viewer::scene::Sides;
use std::cell::RefCell;
use std::collections::BTreeSet;

/// Red, green and blue, as the sliders of σ are marked.
const CHANNELS: [Color32; 3] =
    [Color32::from_rgb(230, 90, 80), Color32::from_rgb(90, 190, 90), Color32::from_rgb(100, 140, 240)];

impl ViewerUi {
    /// The edits that the picture shows.
    pub fn edits(&self) -> &Edits {
        &self.edits
    }

    /// The value as the window opened; `None` where the scene has nothing of this kind.
    pub(super) fn start(&self, target: EditTarget, quantity: EditQuantity) -> Option<f64> {
        self.opened.starts.get(target, quantity).or(quantity.is_factor().then_some(1.0))
    }

    /// The value with `edits`.
    pub(super) fn with(&self, edits: &Edits, target: EditTarget, quantity: EditQuantity) -> Option<f64> {
        edits.get(target, quantity).or_else(|| self.start(target, quantity))
    }

    /// The present value; `None` where the scene has nothing of this kind.
    pub fn value(&self, target: EditTarget, quantity: EditQuantity) -> Option<f64> {
        self.with(&self.edits, target, quantity)
    }

    /// Applies edits: the picture shows what follows from them. What the editor refuses stays as it is, and the message
    /// says why.
    pub fn edit(&mut self, edits: impl IntoIterator<Item = Edit>) {
        self.restore(&self.edits.with(edits, |e| self.start(e.target, e.quantity)));
    }

    /// Restores a leaf as it was fitted, bit for bit.
    pub fn reset(&mut self, leaf: usize) {
        self.restore(&self.edits.replaced(EditGroup::Leaf(leaf), &Edits::default()));
    }

    /// Makes other edits the present ones. A group that the editor refuses stays as it is.
    pub(crate) fn restore(&mut self, to: &Edits) {
        let groups: BTreeSet<EditGroup> = self.edits.iter().chain(to.iter()).map(|e| e.target.group()).collect();
        for group in groups {
            let of = to.of(group);
            if of == self.edits.of(group) {
                continue;
            }
            let made = match group {
                EditGroup::Leaf(leaf) => self.remake(leaf, &of),
                EditGroup::Plants => self.bend(&of),
                EditGroup::Light => self.relight(&of),
            };
            match made {
                Ok(()) => {
                    self.edits = self.edits.replaced(group, &of);
                    self.message.clear();
                }
                Err(reason) => self.message = reason,
            }
        }
    }

    /// The editor solves the slab of a leaf again, and its gloss is the fitted one with the factors.
    fn remake(&mut self, leaf: usize, edits: &Edits) -> Result<(), String> {
        let thickness = self.with(edits, EditTarget::Leaf(leaf), EditQuantity::Thickness);
        let Some(target) = self.made.scene.leaf_mut(leaf) else { return Ok(()) };
        let new = self.editor.recompute(leaf, edits)?;
        let own = || (target.thickness_mm, Sides::of(|side| target.sides[side].interior.clone()));
        let own = self.opened.interiors.entry(leaf).or_insert_with(own);
        let (thickness_mm, mut interiors) = match edits.is_empty() {
            true => own.clone(),
            false => (thickness.map_or(own.0, |v| v as f32), new),
        };
        target.thickness_mm = thickness_mm;
        for (side, maps) in target.sides.iter_mut() {
            std::mem::swap(&mut maps.interior, &mut interiors[side]);
            let of = EditTarget::LeafSide(leaf, side);
            let [s, m] = [EditQuantity::RhoS, EditQuantity::M].map(|q| edits.factor(of, q) as f32);
            let gloss = self.opened.gloss.get(&leaf).and_then(|own| own[side].as_ref());
            maps.gloss = gloss.map(|own| own.iter().map(|t| [t[0] * s, t[1] * s, t[2] * s, t[3] * m]).collect());
        }
        self.made.versions.change(Change::Leaf(leaf));
        Ok(())
    }

    /// A slider, where the scene has its value. It changes the value only when it is moved, because a fit has more
    /// digits than a slider shows.
    pub(super) fn slider(&mut self, ui: &mut egui::Ui, target: EditTarget, quantity: EditQuantity) {
        let Some(now) = self.value(target, quantity) else { return };
        let scale = quantity.scale();
        let [mut low, high] = scale.range;
        // Under the model of a sky the sun cannot go below the horizon.
        if quantity == EditQuantity::Elevation && self.has_model() {
            low = 0.0;
        }
        let sways = [EditQuantity::Lean, EditQuantity::Resonance, EditQuantity::Damping].contains(&quantity);
        // A plant is posed anew when the pointer lets go, because that takes a while.
        let waits = target.group() == EditGroup::Plants;
        let mine = |e: &Edit| (e.target, e.quantity) == (target, quantity);
        let mut value = self.view.pending.filter(mine).map_or(now, |e| e.value);
        let text = RichText::new(format!("{} {}", quantity.word(), scale.name).trim_start());
        let text = match quantity {
            EditQuantity::SigmaA(c) | EditQuantity::SigmaS(c) => text.color(CHANNELS[c]),
            _ => text,
        };
        // A number that is clicked on becomes a text with few digits. While nobody changes the text, it stands for the
        // number with all of its digits.
        let (exact, untouched) = (value, RefCell::new(String::new()));
        let formatter = ui.style().number_formatter.clone();
        let format = |number: f64, decimals| {
            let text = formatter.format(number, decimals);
            if number == exact {
                untouched.borrow_mut().clone_from(&text);
            }
            text
        };
        let parse = |text: &str| match text == *untouched.borrow() {
            true => Some(exact),
            false => text.replace('−', "-").split_whitespace().collect::<String>().parse().ok(),
        };
        let slider = Slider::new(&mut value, low..=high).logarithmic(scale.is_logarithmic()).suffix(scale.unit);
        let slider = slider.max_decimals_opt(scale.decimals).clamping(SliderClamping::Edits).text(text);
        let slider = slider.update_while_editing(!waits).custom_formatter(format).custom_parser(parse);
        let shown = ui.add_enabled(!sways || self.made.scene.wind.is_some(), slider).on_hover_text(scale.hint);
        self.landmark(scale.name, &shown);
        let edit = Edit { target, quantity, value };
        if waits && shown.dragged() && !shown.drag_stopped() {
            self.view.pending = Some(edit);
        } else if value != now {
            self.view.pending = None;
            self.edit([edit]);
        }
    }

    pub(super) fn save(&mut self) {
        self.message = match self.editor.save(self.view.leaf, &self.edits.of(EditGroup::Leaf(self.view.leaf))) {
            Ok(place) => format!("saved: {place}"),
            Err(reason) => format!("not saved: {reason}"),
        };
    }

    pub(super) fn choose(&mut self, leaf: usize) {
        self.view.leaf = leaf;
        if self.view.alone {
            self.show_alone(true);
        }
    }

    pub(super) fn show_alone(&mut self, alone: bool) {
        self.view.alone = alone;
        let made = &mut self.made;
        made.scene.instances = match made.instances.iter().find(|i| i.material == self.view.leaf).filter(|_| alone) {
            Some(one) => vec![*one],
            None => made.instances.clone(),
        };
        // The light that arrives at a leaf between others does not arrive at it when it stands alone.
        made.scene.transfer = if alone { None } else { self.opened.transfer.clone() };
        made.scene.sun_shares = if alone { None } else { made.sun_shares.clone() };
        made.versions.change(Change::Scene);
    }
}
