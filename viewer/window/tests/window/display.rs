//! Windows with a display and without one. Each is opened in a process of its own.

use crate::bench::{bench, two_leaves};
use crate::common::skips;
use mesophyll_viewer::Error;
use mesophyll_window::{WindowOptions, open_window};

/// Runs an ignored test of this program in a process of its own, because a process can open only one window.
fn child(mut command: std::process::Command, test: &str) -> (bool, String) {
    let out = command.args(["--exact", test, "--ignored", "--nocapture"]).output().expect("child");
    let words = format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    // If no test had this name, none would run and the process would succeed. So the count is checked.
    (out.status.success() && words.contains("1 passed"), words)
}

#[test]
fn without_a_display_the_window_says_so() {
    let mut command = std::process::Command::new(std::env::current_exe().expect("path"));
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let (passed, words) = child(command, "display::child_without_display");
    assert!(passed && words.contains("the window could not be opened: there is no display here"), "{words}");
    // The message must not name a place in a library's source on the machine that built it.
    assert!(!words.contains(".rs") && !words.contains("os error"), "{words}");
}

#[test]
#[ignore = "run by without_a_display_the_window_says_so"]
fn child_without_display() {
    let (window, toy) = two_leaves();
    let error = open_window(window, Box::new(toy), &WindowOptions::default()).expect_err("no display");
    assert!(matches!(error, Error::Window(_)));
    println!("{error}");
}

#[test]
fn a_real_window_opens_draws_and_closes() {
    if bench().is_none() {
        return;
    }
    if !std::process::Command::new("xvfb-run").arg("--help").output().is_ok_and(|o| o.status.success()) {
        return skips::skip(skips::Need::Display, "no virtual display (xvfb-run)");
    }
    let mut command = std::process::Command::new("xvfb-run");
    command.args(["-a", "-s", "-screen 0 1100x720x24"]).arg(std::env::current_exe().expect("path"));
    let (passed, words) = child(command, "display::child_with_window");
    assert!(passed, "{words}");
}

#[test]
#[ignore = "run by a_real_window_opens_draws_and_closes"]
fn child_with_window() {
    let (window, toy) = two_leaves();
    let path = std::env::temp_dir().join(format!("mesophyll-window-{}.png", std::process::id()));
    let options =
        WindowOptions { size: [900, 600], frames: Some(3), screenshot: Some(path.clone()), ..Default::default() };
    open_window(window, Box::new(toy), &options).expect("window");
    let shot = image::open(&path).expect("screenshot").to_rgb8();
    std::fs::remove_file(&path).expect("removed");
    let colours: std::collections::HashSet<[u8; 3]> = shot.pixels().map(|p| p.0).collect();
    assert!(
        shot.width() >= 600 && colours.len() > 200,
        "{}x{}, {} colours",
        shot.width(),
        shot.height(),
        colours.len()
    );
}
