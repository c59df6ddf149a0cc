//! Progress on stderr for everything that takes long: bars with the time left on a terminal, otherwise a line every ten
//! seconds, and nothing with `--quiet`.
//!
//! Running work is a stack of [`TaskProgress`]s. The innermost one says what is being done and how far it is; the
//! outermost is the verb.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Once, OnceLock, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Time between two lines where stderr is no terminal.
const EVERY: Duration = Duration::from_secs(10);

static QUIET: AtomicBool = AtomicBool::new(false);
static STOP: AtomicBool = AtomicBool::new(false);
static STAYS: AtomicBool = AtomicBool::new(false);
static PAUSED: AtomicBool = AtomicBool::new(false);
/// What was said since [`listen`].
static HEARD: Mutex<Option<Vec<String>>> = Mutex::new(None);
/// What is under way, outermost first.
static TASKS: Mutex<Vec<Arc<Task>>> = Mutex::new(Vec::new());

/// `--quiet`: no bars and no messages from here on.
pub fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

/// Whether [`set_quiet`] was called with true.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Stops lines of progress: a window is open, and its user decides how long that takes.
pub fn pause() {
    PAUSED.store(true, Ordering::Relaxed);
}

/// Says something on stderr, unless `--quiet`. A program that listens gets it in any case.
pub fn say(text: impl std::fmt::Display) {
    let mut heard = HEARD.lock().unwrap_or_else(PoisonError::into_inner);
    if is_quiet() && heard.is_none() {
        return;
    }
    let text = mesophyll_base::error::short(&text.to_string()).to_string();
    if !is_quiet() {
        bars().suspend(|| eprintln!("{text}"));
    }
    if let Some(heard) = heard.as_mut() {
        heard.push(text);
    }
}

/// From now on what is said is kept, until [`heard`].
pub fn listen() {
    *HEARD.lock().unwrap_or_else(PoisonError::into_inner) = Some(Vec::new());
}

/// What was said since [`listen`].
pub fn heard() -> Vec<String> {
    HEARD.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default()
}

/// Asks running work to stop at the next safe point (Ctrl-C).
pub fn request_stop() {
    STOP.store(true, Ordering::SeqCst);
}

/// Takes back [`request_stop`], in a program that continues after its work was stopped.
pub fn go_on_again() {
    STOP.store(false, Ordering::SeqCst);
}

/// Tells that the program continues after its work was stopped: from now on [`left_when_stopped`] waits until the work
/// has ended.
pub fn stay_when_stopped() {
    STAYS.store(true, Ordering::SeqCst);
}

/// Whether a stop was asked for: long loops look here between pieces of work and return [`crate::Error::Interrupted`].
pub fn stop_requested() -> bool {
    STOP.load(Ordering::SeqCst)
}

/// Asks whether to continue, between two pieces of work that write nothing.
///
/// # Errors
/// [`crate::Error::Interrupted`] once a stop was asked for.
pub fn go_on() -> crate::Result<()> {
    if stop_requested() {
        Err(crate::Error::Interrupted("stopped; nothing was printed or written".into()))
    } else {
        Ok(())
    }
}

/// Does `work` on a separate thread and waits for it. Once a stop was asked for, the thread is abandoned and the answer
/// is `None`: the program is about to end, and what the thread was writing is removed. In this way even work that never
/// checks for a stop ends at once. After [`stay_when_stopped`] the work is waited for, so that none of it continues in
/// the background.
///
/// # Panics
/// Where `work` does.
pub fn left_when_stopped<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> crate::Result<Option<T>> {
    let (done, wait) = mpsc::channel();
    let thread = thread("work", move || {
        // Nobody listens any more where the work was abandoned.
        let _ = done.send(work());
    })?;
    loop {
        match wait.recv_timeout(Duration::from_millis(20)) {
            Ok(made) => return Ok(Some(made)),
            Err(mpsc::RecvTimeoutError::Timeout) if stop_requested() && !STAYS.load(Ordering::SeqCst) => break,
            Err(mpsc::RecvTimeoutError::Timeout) => {}
            Err(mpsc::RecvTimeoutError::Disconnected) => match thread.join() {
                Err(panic) => std::panic::resume_unwind(panic),
                Ok(()) => break,
            },
        }
    }
    pause();
    bars().set_draw_target(indicatif::ProgressDrawTarget::hidden());
    crate::atomic::remove_unfinished();
    Ok(None)
}

/// Starts a thread. Its stack is a part of the memory that the program may have.
///
/// # Errors
/// [`crate::Error::Missed`] where there is too little memory, or no more threads are allowed.
pub fn thread<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> crate::Result<std::thread::JoinHandle<T>> {
    std::thread::Builder::new().name(name.into()).spawn(work).map_err(|e| no_thread(&e))
}

/// The sentence for a thread that could not be started.
pub fn no_thread(why: &dyn std::fmt::Display) -> crate::Error {
    let hint = crate::memory::hint();
    let why = why.to_string();
    let why = why.split(" (os error").next().unwrap_or(&why);
    crate::Error::Missed(format!("too little memory for another thread, or no more are allowed ({why}){hint}"))
}

/// A piece of work and how far it is.
#[derive(Debug)]
struct Task {
    what: String,
    /// Number of steps in all; 0 where it is not known.
    total: AtomicU64,
    done: AtomicU64,
    start: Instant,
}

impl Task {
    fn total(&self) -> u64 {
        self.total.load(Ordering::Relaxed)
    }

    /// `scanning: 12 of 240 (5 %) after 10 s, about 3 min 10 s left`.
    fn line(&self, elapsed: Duration) -> String {
        let (done, total, what) = (self.done.load(Ordering::Relaxed), self.total(), &self.what);
        let after = shown(elapsed);
        match (done, total) {
            (0, 0) => format!("{what}: {after} so far"),
            (_, 0) => format!("{what}: {done} done after {after}"),
            (0, _) => format!("{what}: 0 of {total} after {after}"),
            _ => {
                let left = elapsed.mul_f64((total.saturating_sub(done)) as f64 / done as f64);
                let percent = 100.0 * done as f64 / total as f64;
                format!("{what}: {done} of {total} ({percent:.0} %) after {after}, about {} left", shown(left))
            }
        }
    }
}

/// `8 s`, `3 min 10 s`, `2 h 5 min`.
fn shown(time: Duration) -> String {
    let s = time.as_secs_f64().round() as u64;
    match (s / 3600, s / 60 % 60, s % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s} s"),
        (h, m, _) => format!("{h} h {m} min"),
    }
}

/// The bars of a terminal, one below the other.
fn bars() -> &'static indicatif::MultiProgress {
    static BARS: OnceLock<indicatif::MultiProgress> = OnceLock::new();
    BARS.get_or_init(indicatif::MultiProgress::new)
}

fn tasks() -> std::sync::MutexGuard<'static, Vec<Arc<Task>>> {
    TASKS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The line to print now: all running work from the verb to the innermost one, with the time of the innermost.
fn state(tasks: &[Arc<Task>]) -> Option<String> {
    let (inner, outer) = tasks.split_last()?;
    let around = outer.iter().map(|t| match t.total() {
        0 => format!("{}: ", t.what),
        total => format!("{} ({} of {total} done): ", t.what, t.done.load(Ordering::Relaxed)),
    });
    Some(around.collect::<String>() + &inner.line(inner.start.elapsed()))
}

/// Starts the thread that prints the lines, once. It ends with the program.
fn print_lines() {
    static STARTED: Once = Once::new();
    STARTED.call_once(|| {
        // Without a thread for them there are no lines.
        let _ = thread("progress", || {
            loop {
                std::thread::sleep(EVERY);
                let line = state(&tasks());
                if let Some(line) = line.filter(|_| !is_quiet() && !PAUSED.load(Ordering::Relaxed)) {
                    // If the reader of stderr went away, that is no reason to end.
                    let _ = std::io::Write::write_all(&mut std::io::stderr(), format!("{line}\n").as_bytes());
                }
            }
        });
    });
}

/// A piece of work under way, of `total` steps (0: nobody knows how many). It ends when the value is dropped.
#[derive(Debug)]
pub struct TaskProgress {
    task: Arc<Task>,
    drawn: indicatif::ProgressBar,
}

impl TaskProgress {
    /// Begins a piece of work of `total` steps.
    pub fn new(what: impl Into<String>, total: u64) -> Self {
        let outermost = tasks().is_empty();
        let task =
            Arc::new(Task { what: what.into(), total: total.into(), done: AtomicU64::new(0), start: Instant::now() });
        tasks().push(task.clone());
        let drawn = if is_quiet() || PAUSED.load(Ordering::Relaxed) {
            indicatif::ProgressBar::hidden()
        } else if !std::io::stderr().is_terminal() {
            print_lines();
            indicatif::ProgressBar::hidden()
        } else if outermost && total == 0 {
            // The bar of the verb itself is hidden, because the bars inside it say more.
            indicatif::ProgressBar::hidden()
        } else {
            drawn(&task)
        };
        TaskProgress { task, drawn }
    }

    /// Work without a count of steps.
    pub fn of(what: impl Into<String>) -> Self {
        TaskProgress::new(what, 0)
    }

    /// Reports that this many more steps are done.
    pub fn advance(&self, steps: u64) {
        self.task.done.fetch_add(steps, Ordering::Relaxed);
        self.drawn.inc(steps);
    }

    /// Sets the number of steps that are now expected in all.
    pub fn set_total(&self, total: u64) {
        if self.task.total.swap(total, Ordering::Relaxed) == 0 {
            styled(&self.drawn, total);
        }
        self.drawn.set_length(total);
    }

    /// Reports one more step, and stops where a stop was asked for.
    ///
    /// # Errors
    /// As [`go_on`].
    pub fn step(&self) -> crate::Result<()> {
        self.advance(1);
        go_on()
    }
}

/// A bar on the terminal.
fn drawn(task: &Task) -> indicatif::ProgressBar {
    let bar = match task.total() {
        0 => indicatif::ProgressBar::new_spinner(),
        total => indicatif::ProgressBar::new(total),
    };
    let bar = bars().add(bar.with_prefix(task.what.clone()));
    styled(&bar, task.total());
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

fn styled(bar: &indicatif::ProgressBar, total: u64) {
    let template = match total {
        0 => "{prefix:>22} {spinner} {elapsed}",
        _ => "{prefix:>22} {wide_bar} {percent:>3} %  {eta} left",
    };
    if let Ok(style) = indicatif::ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
}

impl Drop for TaskProgress {
    fn drop(&mut self) {
        tasks().retain(|t| !Arc::ptr_eq(t, &self.task));
        self.drawn.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn task(what: &str, total: u64, done: u64) -> Arc<Task> {
        Arc::new(Task { what: what.into(), total: total.into(), done: AtomicU64::new(done), start: Instant::now() })
    }

    #[test]
    fn a_line_says_what_is_done_how_far_it_is_and_how_long_it_takes() {
        let after = Duration::from_secs(30);
        // A quarter took 30 s, so three quarters take 90 s.
        assert_eq!(
            task("scanning", 240, 60).line(after),
            "scanning: 60 of 240 (25 %) after 30 s, about 1 min 30 s left"
        );
        assert_eq!(task("scanning", 240, 0).line(after), "scanning: 0 of 240 after 30 s");
        assert_eq!(task("rows", 0, 7).line(after), "rows: 7 done after 30 s");
        assert_eq!(task("plan", 0, 0).line(Duration::from_secs(7530)), "plan: 2 h 5 min so far");
    }

    #[test]
    fn the_innermost_work_speaks_for_its_verb() {
        assert_eq!(state(&[]), None);
        assert_eq!(state(&[task("check", 0, 0)]).as_deref(), Some("check: 0 s so far"));
        let nested = [task("check", 0, 0), task("views", 3, 1), task("reference of front", 10, 0)];
        assert_eq!(
            state(&nested).as_deref(),
            Some("check: views (1 of 3 done): reference of front: 0 of 10 after 0 s")
        );
    }
}
