//! The verbs, one file for each: they turn arguments into an exit code. There is no physics here.

#![warn(missing_docs)]

use clap::{CommandFactory, Parser, Subcommand};
use mesophyll_base::processor::{self, InstructionSet};
use mesophyll_files::{memory::left_of_limit, progress};
use std::process::ExitCode;

mod batch;
mod bench;
mod check;
mod completions;
mod design;
mod destination;
mod display;
mod dress;
mod embedded;
mod eval;
mod export;
mod film;
mod fit;
mod grow;
mod import;
mod inspect;
mod man;
mod memory;
mod models;
mod names;
mod numbers;
mod peers;
mod pictures;
mod plan;
mod preparation;
mod render;
mod report;
mod run;
mod stress;
mod synth;
mod tables;
mod verb_choice;
mod view;
pub use embedded::{VerbAnswer, answer};
pub use memory::ReportingAllocator;
pub(crate) use mesophyll_base::error::{Error, Result};

#[derive(Debug, Parser)]
#[command(
    name = "mesophyll",
    version,
    about = "Fits leaf, branch and sky appearance from measurements, and proves the fit in pictures",
    max_term_width = 110,
    after_help = "Exit codes: 0 done (of a table: at least one row was answered), 1 a fit as a whole, a check or every \
                  row of a table missed its mark, or an output could not be written, 2 wrong usage or an input that \
                  cannot be read, 130 stopped.\n\n`mesophyll man glossary` explains words and signs."
)]
struct Cli {
    #[command(flatten)]
    common: CommonArgs,
    #[command(subcommand)]
    verb: Verb,
}

/// Options every verb takes.
#[derive(Debug, Clone, clap::Args)]
pub struct CommonArgs {
    /// Worker threads, 1 to 1024 (default: one a core)
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// No progress and no messages; results and errors only
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Results as JSON on standard output, where the verb has any
    #[arg(long, global = true)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Fit what a scene needs, report, render and check: the main job
    Run(run::Args),
    /// Say what a scene needs, what is left out and why
    Plan(plan::Args),
    /// Validate and summarise a capture without fitting
    Inspect(inspect::Args),
    /// Scan a synthetic leaf as a linear light source device would
    Synth(synth::Args),
    /// Fit parameters to measurements
    Fit(fit::Args),
    /// Evaluate a model on a table
    Eval(eval::Args),
    /// Plan which readings to take
    Design(design::Args),
    /// Report how good fits are; two fits are compared
    Report(report::Args),
    /// Error against run time, over each model's accuracy knob
    Bench(bench::Args),
    /// Run the committed table of stiff and extreme cases
    Stress(stress::Args),
    /// Render a scene and judge it against the reference renderer
    Check(check::Args),
    /// Draw a scene with light between its leaves: a path tracer
    Render(render::Args),
    /// Draw a moving scene as a film
    Film(film::Args),
    /// Grow a plant from its description
    Grow(grow::Args),
    /// Find the branches of a plant that is nothing but triangles
    Import(import::Args),
    /// Put fitted leaves on a plant that another program wrote
    Dress(dress::Args),
    /// Open a scene in a window
    View(view::Args),
    /// Write fits in formats other programs read
    Export(export::Args),
    /// Print a shell completion script
    Completions(completions::Args),
    /// Print the manual page of the program or of a verb
    Man(man::Args),
}

impl Verb {
    fn name(&self) -> &'static str {
        match self {
            Verb::Run(_) => "run",
            Verb::Plan(_) => "plan",
            Verb::Inspect(_) => "inspect",
            Verb::Synth(_) => "synth",
            Verb::Fit(_) => "fit",
            Verb::Eval(_) => "eval",
            Verb::Design(_) => "design",
            Verb::Report(_) => "report",
            Verb::Bench(_) => "bench",
            Verb::Stress(_) => "stress",
            Verb::Check(_) => "check",
            Verb::Render(_) => "render",
            Verb::Film(_) => "film",
            Verb::Grow(_) => "grow",
            Verb::Import(_) => "import",
            Verb::Dress(_) => "dress",
            Verb::View(_) => "view",
            Verb::Export(_) => "export",
            Verb::Completions(_) => "completions",
            Verb::Man(_) => "man",
        }
    }
}

/// Parses the command line, runs the verb, prints an error once.
pub fn main() -> ExitCode {
    let cli = match numbers::read(std::env::args_os()) {
        Ok(cli) => cli,
        Err(e) => {
            // Help and version are answers (0); anything else is usage (2). A closed pipe is not our failure.
            let _ = e.print();
            return ExitCode::from(if e.use_stderr() { 2 } else { 0 });
        }
    };
    memory::prepare();
    display::quiet_libraries();
    progress::set_quiet(cli.common.quiet);
    stop_on_ctrl_c();
    let _verb = progress::TaskProgress::of(cli.verb.name());
    match carried_out(cli) {
        Ok(code) => ExitCode::from(code),
        Err(e) => {
            if !matches!(e, Error::BrokenPipe) {
                eprintln!("mesophyll: {e}");
            }
            ExitCode::from(exit_code(&e))
        }
    }
}

/// Exit code: 0 done, 1 a fit, a check or a whole table missed (or could not be written), 2 usage or unreadable input,
/// 130 interrupted.
fn exit_code(e: &Error) -> u8 {
    match e {
        Error::BrokenPipe => 0,
        Error::Interrupted(_) => 130,
        _ if e.is_usage() => 2,
        _ => 1,
    }
}

/// Starts the worker threads, so that a want of memory is said before any of them is needed.
fn workers(common: &CommonArgs) -> Result<()> {
    // The standard library ends with a panic where the last memory goes into a thread; so it is looked for before.
    let threads = common.threads.unwrap_or_default();
    if left_of_limit().is_some_and(|left| left < u64::from(threads) << 21) {
        return Err(progress::no_thread(&format!("{threads} threads have stacks of 2 MiB each")));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
    pool.build_global().map_err(|e| progress::no_thread(&e))
}

/// Does the verb. One that seldom looks for a stop is left at once after Ctrl-C.
fn carried_out(cli: Cli) -> Result<u8> {
    InstructionSet::limit()
        .map_err(|found| Error::argument(processor::SWITCH, found, InstructionSet::NAMES.join(", ")))?;
    workers(&cli.common)?;
    if !matches!(cli.verb, Verb::Report(_) | Verb::Bench(_) | Verb::Stress(_)) {
        return dispatch(&cli);
    }
    progress::left_when_stopped(move || dispatch(&cli))?.unwrap_or_else(|| {
        destination::remove_temporary();
        Err(Error::Interrupted("stopped; nothing was printed".into()))
    })
}

fn dispatch(cli: &Cli) -> Result<u8> {
    let common = &cli.common;
    if common.json && matches!(cli.verb, Verb::View(_) | Verb::Completions(_) | Verb::Man(_)) {
        return Err(Error::Usage("--json: view, completions and man have no results that JSON could hold".into()));
    }
    match &cli.verb {
        Verb::Run(a) => run::run(a, common),
        Verb::Plan(a) => plan::run(a, common),
        Verb::Inspect(a) => inspect::run(a, common),
        Verb::Synth(a) => synth::run(a, common),
        Verb::Fit(a) => fit::run(a, common),
        Verb::Eval(a) => eval::run(a, common),
        Verb::Design(a) => design::run(a, common),
        Verb::Report(a) => report::run(a, common),
        Verb::Bench(a) => bench::run(a, common),
        Verb::Stress(a) => stress::run(a, common),
        Verb::Check(a) => check::run(a, common),
        Verb::Render(a) => render::run(a, common),
        Verb::Film(a) => film::run(a, common),
        Verb::Grow(a) => grow::run(a, common),
        Verb::Import(a) => import::run(a, common),
        Verb::Dress(a) => dress::run(a, common),
        Verb::View(a) => view::run(a, common),
        Verb::Export(a) => export::run(a, common),
        Verb::Completions(a) => completions::run(a),
        Verb::Man(a) => man::run(a),
    }
}

/// The first Ctrl-C asks running work to stop at a safe point, the second stops at once.
fn stop_on_ctrl_c() {
    let _ = ctrlc::set_handler(|| {
        if progress::stop_requested() {
            std::process::exit(130);
        }
        progress::request_stop();
        progress::say("stopping at the next safe point; press Ctrl-C again to stop at once");
    });
}

/// Prints to standard output; a reader that went away ends the run quietly.
pub fn print(text: &str) -> Result<()> {
    print_bytes(text.as_bytes())
}

/// As [`print`], for a file that is not text.
fn print_bytes(bytes: &[u8]) -> Result<()> {
    use std::io::Write;
    let mut out = mesophyll_files::standard_output::StandardOutput;
    out.write_all(bytes).and_then(|()| out.flush()).map_err(mesophyll_files::table::stdout_error)
}

/// Prints a value as indented JSON and a newline.
pub fn print_json<T: serde::Serialize>(value: &T) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))?;
    print(&format!("{text}\n"))
}

/// What the verbs are for, in the order of the help: a verb stands in one group.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Measure", &["inspect", "synth", "design"]),
    ("Fit", &["run", "plan", "fit", "eval"]),
    ("Draw", &["check", "render", "film", "view"]),
    ("Exchange", &["grow", "import", "dress", "export"]),
    ("Prove", &["report", "bench", "stress"]),
    ("Help", &["help", "man", "completions"]),
];

/// The command line as clap knows it. Its help lists the verbs in groups.
pub fn command() -> clap::Command {
    let command = Cli::command();
    let here = "Print this message, or the help of a verb";
    let verb = |verb: &str| command.find_subcommand(verb)?.get_about().map(ToString::to_string);
    let about = |name: &str| verb(name).unwrap_or_else(|| here.into());
    let mut text = String::from("{about-with-newline}\n{usage-heading} {usage}\n");
    for (group, verbs) in GROUPS {
        text += &format!("\n{group}:\n");
        verbs.iter().for_each(|verb| text += &format!("  {verb:<12} {}\n", about(verb)));
    }
    command.help_template(text + "\nOptions:\n{options}{after-help}")
}

#[cfg(test)]
mod tests;
