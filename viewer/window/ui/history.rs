//! Undo and redo. A step is whatever was changed until the pointer let go and no field was typed in: an edit of a leaf,
//! of branches, or of the lights. The camera is no edit.

use super::ViewerUi;
use crate::edit::{Edit, Edits};
use egui::{Key, Modifiers};

/// Most steps that are kept.
const MOST: usize = 200;

/// The edits that a step made, and those that take it back.
struct Step {
    forth: Vec<Edit>,
    back: Vec<Edit>,
}

/// The steps until the present state and, after an undo, those after it.
#[derive(Default)]
pub(crate) struct History {
    past: Vec<Step>,
    future: Vec<Step>,
    /// The edits after the last step.
    settled: Edits,
}

impl ViewerUi {
    /// Takes the present state as a step, unless a drag or typing is still going on.
    pub(super) fn remember(&mut self, context: &egui::Context) {
        if !context.input(|i| i.pointer.any_down()) && !context.egui_wants_keyboard_input() {
            self.settle();
        }
    }

    fn settle(&mut self) {
        let start = |e: &Edit| self.start(e.target, e.quantity);
        let (now, before) = (&self.edits, &self.history.settled);
        if now != before {
            let step = Step { forth: now.since(before, start), back: before.since(now, start) };
            self.history.settled = now.clone();
            self.history.past.push(step);
            self.history.future.clear();
            if self.history.past.len() > MOST {
                self.history.past.remove(0);
            }
        }
    }

    /// Takes the last step back.
    pub fn undo(&mut self) {
        self.settle();
        if let Some(step) = self.history.past.pop() {
            self.edit(step.back.iter().copied());
            self.history.settled = self.edits.clone();
            self.history.future.push(step);
        }
    }

    /// Takes a step again that was taken back.
    pub fn redo(&mut self) {
        self.settle();
        if let Some(step) = self.history.future.pop() {
            self.edit(step.forth.iter().copied());
            self.history.settled = self.edits.clone();
            self.history.past.push(step);
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
