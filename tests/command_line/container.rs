//! The image of `Containerfile`, built and tried where there is a program that builds images.

use crate::common::skips::{Need, skip};
use std::process::Command;

#[test]
fn the_image_is_built_and_fits_and_draws() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/.ci/container");
    let made = Command::new(script).output().expect("the script starts");
    let said = String::from_utf8_lossy(&made.stderr);
    match made.status.code() {
        Some(3) => skip(Need::Peer, said.lines().last().unwrap_or_default()),
        Some(0) => {
            let out = String::from_utf8_lossy(&made.stdout);
            assert!(out.contains("sigma_a") && out.contains(",ok"), "{out}");
        }
        code => panic!("{code:?}: {said}"),
    }
}
