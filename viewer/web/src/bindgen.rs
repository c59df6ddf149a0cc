//! Makes a module for browsers of the compiled viewer: `mesophyll-bindgen FILE.wasm FOLDER` writes `crate.js`
//! and `mesophyll_web_bg.wasm`. It does what the program `wasm-bindgen` does, in the version of this workspace's lock
//! file.

use std::process::ExitCode;

fn main() -> ExitCode {
    let [_, wasm, folder] = std::env::args().collect::<Vec<_>>().try_into().unwrap_or_default();
    if folder.is_empty() {
        eprintln!("expected a .wasm file and a folder");
        return ExitCode::from(2);
    }
    let mut made = wasm_bindgen_cli_support::Bindgen::new();
    let done = made.input_path(&wasm).web(true).and_then(|b| b.typescript(false).generate(&folder));
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{wasm}: {error:#}");
            ExitCode::FAILURE
        }
    }
}
