//! Undo and redo. A step is whatever was changed until the pointer let go and no field was typed in: an edit of a leaf,
//! of branches, or of the lights. The camera is no edit.

use super::ViewerUi;
use super::light::Light;
use crate::editor::{LeafEdit, PlantEdits};
use egui::{Key, Modifiers};
use std::collections::BTreeMap;

/// Most steps that are kept.
const MOST: usize = 200;

/// Everything that a user edits.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Snapshot {
    pub leaves: BTreeMap<usize, LeafEdit>,
    pub branches: PlantEdits,
    pub light: Light,
}

/// The states before the present one and, after an undo, those after it.
#[derive(Default)]
pub(crate) struct History {
    past: Vec<Snapshot>,
    future: Vec<Snapshot>,
    /// The state after the last step.
    settled: Snapshot,
}

impl History {
    pub(crate) fn new(settled: Snapshot) -> History {
        History { settled, ..History::default() }
    }
}

impl ViewerUi {
    /// The present state.
    pub(crate) fn snapshot(&self) -> Snapshot {
        let (leaves, branches) = (self.edits.clone(), self.branch_edits().clone());
        Snapshot { leaves, branches, light: self.light() }
    }

    /// Makes a state the present one. What the editor refuses stays as it is, and the message says why.
    pub(crate) fn restore(&mut self, to: &Snapshot) {
        for (leaf, edit) in &to.leaves {
            match self.edits.get(leaf) == Some(edit) {
                true => {}
                false if self.starts.get(leaf) == Some(edit) => self.reset(*leaf),
                false => self.set_edit(*leaf, *edit),
            }
        }
        if to.branches != *self.branch_edits() {
            self.bend(to.branches.clone());
        }
        self.set_light(to.light);
    }

    /// Takes the present state as a step, unless a drag or typing is still going on.
    pub(super) fn remember(&mut self, context: &egui::Context) {
        if !context.input(|i| i.pointer.any_down()) && !context.egui_wants_keyboard_input() {
            self.settle();
        }
    }

    fn settle(&mut self) {
        let now = self.snapshot();
        if now != self.history.settled {
            self.history.past.push(std::mem::replace(&mut self.history.settled, now));
            self.history.future.clear();
            if self.history.past.len() > MOST {
                self.history.past.remove(0);
            }
        }
    }

    /// Takes the last step back.
    pub fn undo(&mut self) {
        self.settle();
        if let Some(to) = self.history.past.pop() {
            self.history.future.push(self.history.settled.clone());
            self.restore(&to);
            self.history.settled = self.snapshot();
        }
    }

    /// Takes a step again that was taken back.
    pub fn redo(&mut self) {
        self.settle();
        if let Some(to) = self.history.future.pop() {
            self.history.past.push(self.history.settled.clone());
            self.restore(&to);
            self.history.settled = self.snapshot();
        }
    }

    pub(super) fn history_buttons(&mut self, ui: &mut egui::Ui) {
        let undo = ui.add_enabled(!self.history.past.is_empty(), egui::Button::new("Undo"));
        let redo = ui.add_enabled(!self.history.future.is_empty(), egui::Button::new("Redo"));
        self.landmark("undo", &undo);
        self.landmark("redo", &redo);
        if undo.on_hover_text("takes the last edit back (Ctrl+Z)").clicked() {
            self.undo();
        }
        if redo.on_hover_text("takes it again (Ctrl+Shift+Z or Ctrl+Y)").clicked() {
            self.redo();
        }
    }

    /// The keys, which belong to a field while somebody types in it.
    pub(super) fn history_keys(&mut self, context: &egui::Context) {
        if context.egui_wants_keyboard_input() {
            return;
        }
        let pressed = |modifiers, key| context.input_mut(|i| i.consume_key(modifiers, key));
        if pressed(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || pressed(Modifiers::COMMAND, Key::Y) {
            self.redo();
        } else if pressed(Modifiers::COMMAND, Key::Z) {
            self.undo();
        }
    }
}
