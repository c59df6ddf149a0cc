//! Numbers beside sliders: a field that is opened and left as it was.

use crate::bench::{Bench, bench, thick};
use egui::{Event, Key, Modifiers};

fn key(key: Key, modifiers: Modifiers) -> Event {
    Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers }
}

fn press(bench: &mut Bench, which: Key) {
    bench.frame(vec![key(which, Modifiers::NONE)]);
    bench.frame(vec![]);
    bench.frame(vec![]);
}

/// A number that is clicked on shows fewer digits than it has. Leaving it by Enter, by Tab or by a click elsewhere is
/// no edit; digits that are typed are one.
#[test]
fn a_number_that_is_left_untouched_is_no_edit() {
    let Some(mut bench) = bench() else { return };
    let slider = bench.ui.landmark_rect("h").expect("slider");
    let number = egui::pos2(slider.left() + 125.0, slider.center().y);
    let click = |bench: &mut Bench, at: egui::Pos2| {
        bench.frame(vec![Event::PointerMoved(at)]);
        bench.frame(vec![Bench::button(at, true)]);
        bench.frame(vec![Bench::button(at, false)]);
        bench.frame(vec![]);
    };
    let exact = 0.234_567_890_123;
    bench.ui.edit([thick(0, exact)]);
    bench.frame(vec![]);
    let before = bench.leaf();
    for leave in [Key::Enter, Key::Tab, Key::Escape] {
        click(&mut bench, number);
        press(&mut bench, leave);
        assert_eq!((bench.thickness(), bench.leaf()), (exact, before.clone()), "{leave:?}");
    }
    click(&mut bench, number);
    click(&mut bench, egui::pos2(560.0, 5.0));
    assert_eq!(bench.thickness(), exact);
    // The same way in with another number changes it, so that the clicks above did open the field.
    click(&mut bench, number);
    bench.frame(vec![key(Key::A, Modifiers::COMMAND)]);
    bench.frame(vec![Event::Text("0.345".into())]);
    press(&mut bench, Key::Enter);
    assert_eq!(bench.thickness(), 0.345);
}
