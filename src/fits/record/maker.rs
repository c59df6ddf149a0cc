//! The one way to make a fit folder. Every fit that leaves a folder goes through [`make`].
//!
//! [`make`] runs the fit on a thread of its own. When Ctrl-C asks for a stop, it leaves that thread and returns
//! [`Error::Interrupted`] at once, whatever is being computed. Nothing is lost by that: every file is written whole or
//! not at all, `fit.toml` is written last, and parts that a long fit has finished ([`FitMaker::part`],
//! [`FitMaker::parts`]) are taken over by the next run.
//!
//! The fit itself is a function that gets a [`FitMaker`]. It reads its inputs and states what it is made from
//! ([`FitMaker::up_to_date`]). That claims the folder, and a folder that belongs to something else is refused. Then the
//! fit computes, opens the folder for writing ([`FitMaker::begin`]), writes its maps, and hands over its record
//! ([`FitMaker::finish`]). So an input that cannot be read is reported before the folder is touched.

use crate::record::next::NextMeasurement;
use crate::record::{Error, FitKind, FitRecord, FitTimes, Result, read_toml, write_toml};
use mesophyll_files::claim::{self, FolderClaim, OutputKind};
use mesophyll_files::{atomic, hash, progress};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

/// How a fit of a folder ended.
#[derive(Debug)]
pub enum FitOutcome {
    /// The fit is complete.
    Done(Box<FitRecord>),
    /// The folder already held this very fit; nothing was computed.
    UpToDate(Box<FitRecord>),
    /// One shard of several is done; the fit is complete when all shards are and `--merge` has run.
    ShardDone {
        /// How many shards are still to be made.
        missing: usize,
    },
}

/// A fit folder that is being made.
#[derive(Debug)]
pub struct FitMaker {
    kind: FitKind,
    out: PathBuf,
    inputs: Vec<PathBuf>,
    clock: Instant,
    input_hash: String,
    /// The contents of `times.toml`: phases, traces, the capture's place.
    pub times: FitTimes,
    /// Folder of the finished parts; empty for a fit without parts.
    parts: Arc<OnceLock<PathBuf>>,
    /// Whether other shards may write to the folder too.
    shared: bool,
    /// The folder's lock. [`make`] has it too, so that it ends last of all, and stays with a thread that was left.
    claim: Arc<OnceLock<FolderClaim>>,
    /// Held while the folder is claimed or marked. A stop waits for the end of that, so that it can be taken back.
    claiming: Arc<Mutex<()>>,
}

/// Hash of everything that decides a fit: what it is made from, by name, and the program's version.
pub fn input_hash<'a>(parts: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    hash::combine(parts.into_iter().chain([("program", env!("CARGO_PKG_VERSION"))]))
}

/// Makes a fit of `kind` from `inputs` in the folder `out` by calling `fit`. If the folder did not exist before and
/// nothing was written to it, it is removed again.
///
/// # Errors
/// Those of `fit`. [`Error::Interrupted`] after a stop was asked for; it says what is kept.
pub fn make<T: Send + 'static>(
    kind: FitKind,
    out: &Path,
    inputs: &[&Path],
    fit: impl FnOnce(&mut FitMaker) -> Result<T> + Send + 'static,
) -> Result<T> {
    let clock = Instant::now();
    let new: Vec<PathBuf> = out.ancestors().take_while(|f| !f.exists()).map(Path::to_path_buf).collect();
    let (parts, claim, claiming) = (Arc::new(OnceLock::new()), Arc::new(OnceLock::new()), Arc::new(Mutex::new(())));
    let mut maker = FitMaker {
        kind,
        out: out.to_path_buf(),
        inputs: inputs.iter().map(|input| input.to_path_buf()).collect(),
        clock,
        input_hash: String::new(),
        times: FitTimes { threads: rayon::current_num_threads(), ..FitTimes::default() },
        parts: parts.clone(),
        shared: false,
        claim: claim.clone(),
        claiming: claiming.clone(),
    };
    let done = progress::left_when_stopped(move || fit(&mut maker))?;
    let _turn = claiming.lock();
    let made = match done {
        None | Some(Err(Error::Interrupted(_))) => Err(stopped(out, parts.get())),
        Some(made) => made,
    };
    if made.is_err() {
        claim::undo(&new, claim.get());
    }
    made
}

/// What a stop leaves behind.
fn stopped(out: &Path, parts: Option<&PathBuf>) -> Error {
    let there = |folder: &&PathBuf| std::fs::read_dir(folder).is_ok_and(|mut list| list.next().is_some());
    Error::Interrupted(match parts.filter(there) {
        Some(parts) => {
            format!("interrupted; finished parts are kept in {}, run the same command again to go on", parts.display())
        }
        None if out.join(claim::MARK).exists() => {
            format!("interrupted; {} holds no whole fit, run the same command again", out.display())
        }
        None => "stopped; nothing was printed or written".into(),
    })
}

impl FitMaker {
    /// Does one phase of the fit and records how long it took.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn phase<T>(&mut self, name: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        progress::go_on()?;
        let start = Instant::now();
        let done = work()?;
        self.times.phase(name, start);
        Ok(done)
    }

    /// States what the fit is made from (see [`input_hash`]), and claims the folder until [`make`] ends. To be said
    /// once.
    ///
    /// # Errors
    /// As [`claim::folder_for`]: a folder that cannot be written, or that holds something else, or that another run
    /// writes.
    pub fn made_from(&mut self, input_hash: String) -> Result<()> {
        self.input_hash = input_hash;
        let inputs: Vec<&Path> = self.inputs.iter().map(PathBuf::as_path).collect();
        let with = if self.shared { claim::ClaimMode::Shared } else { claim::ClaimMode::Alone };
        let _turn = self.claiming.lock();
        progress::go_on()?;
        let claim = claim::folder_for(&self.out, OutputKind::Fit(self.kind.name()), &inputs, with)?;
        // Nobody has set it before: a second claim would have been refused.
        let _ = self.claim.set(claim);
        Ok(())
    }

    /// States that this run is one shard of several, which write their parts at the same time. To be said before
    /// [`FitMaker::made_from`].
    pub fn one_of_several(&mut self) {
        self.shared = true;
    }

    /// Waits, in a shard that puts the parts of all together, until no other shard writes. Returns the fit if another
    /// one has finished it meanwhile.
    ///
    /// # Errors
    /// [`Error::Interrupted`] after a stop.
    pub fn alone(&self) -> Result<Option<FitOutcome>> {
        match self.claim.get() {
            Some(claim) if self.shared => claim.alone()?,
            _ => return Ok(None),
        }
        Ok(self.whole())
    }

    /// The fit that the folder holds, if it is exactly this fit and unchanged.
    fn whole(&self) -> Option<FitOutcome> {
        let found = FitRecord::read(&self.out).ok().filter(|record| record.input_hash == self.input_hash);
        found.filter(|record| record.verify(&self.out).is_ok()).map(|record| FitOutcome::UpToDate(Box::new(record)))
    }

    /// As [`FitMaker::made_from`]. Returns the fit that the folder holds if it is exactly this fit and unchanged; with
    /// `force` it returns none.
    ///
    /// # Errors
    /// As [`FitMaker::made_from`].
    pub fn up_to_date(&mut self, input_hash: String, force: bool) -> Result<Option<FitOutcome>> {
        self.made_from(input_hash)?;
        Ok(if force { None } else { self.whole() })
    }

    /// The folder of the fit.
    pub fn folder(&self) -> &Path {
        &self.out
    }

    /// Folder for the parts of this fit. The parts of a stopped run are found there only when the same fit is made from
    /// the same inputs. `format` describes what a part holds, so that a program with other parts starts again.
    pub fn parts(&self, format: &str) -> &Path {
        self.parts.get_or_init(|| {
            let mine = hash::combine([("input", self.input_hash.as_str()), ("format", format)]);
            self.out.join(format!("parts-{}-{}", self.kind, &mine[..12]))
        })
    }

    /// Takes over a part from a stopped run, or makes it. `make` writes files into the folder that it gets, and returns
    /// further results of the part. [`FitMaker::take_parts`] brings the files into the fit's folder.
    ///
    /// # Errors
    /// Those of `make`; a folder that cannot be written.
    pub fn part<T: Serialize + DeserializeOwned>(
        &mut self,
        format: &str,
        name: &str,
        make: impl FnOnce(&Path, &mut FitTimes) -> Result<T>,
    ) -> Result<T> {
        let folder = self.parts(format).to_path_buf();
        let told = folder.join(format!("{name}{PART}"));
        if told.exists() {
            return read_toml(&told);
        }
        let part = make(&folder, &mut self.times)?;
        write_toml(&told, &part)?;
        Ok(part)
    }

    /// Copies the files of all parts into the fit's folder. The parts stay until [`FitMaker::finish`], so that a stop
    /// in between loses none.
    ///
    /// # Errors
    /// A file that cannot be read or written.
    pub fn take_parts(&self) -> Result<()> {
        let Some(parts) = self.parts.get() else { return Ok(()) };
        let unread = |e: std::io::Error| Error::input(parts, atomic::explain(&e));
        for entry in std::fs::read_dir(parts).map_err(unread)?.flatten() {
            let name = entry.file_name();
            let shown = name.to_string_lossy();
            if !shown.ends_with(PART) && !shown.starts_with('.') {
                let mut file = std::fs::File::open(entry.path()).map_err(unread)?;
                atomic::write(&self.out.join(&name), |to| std::io::copy(&mut file, to).map(drop))?;
            }
        }
        Ok(())
    }

    /// Opens the folder for writing. Until [`FitMaker::finish`] it is marked as an incomplete fit, and the record of an
    /// earlier fit is removed.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn begin(&self) -> Result<&Path> {
        let _turn = self.claiming.lock();
        progress::go_on()?;
        claim::begin(&self.out, OutputKind::Fit(self.kind.name()))?;
        Ok(&self.out)
    }

    /// The record of this fit, with only what every fit states.
    pub fn record(&self, name: &str) -> FitRecord {
        FitRecord::new(self.kind, name, self.input_hash.clone())
    }

    /// Writes `times.toml` and, last of all, `fit.toml`, which also names what to measure next. The parts are no longer
    /// needed then and are removed, while the folder is still claimed. Returns the record as it was written.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn finish(&mut self, mut record: FitRecord) -> Result<Box<FitRecord>> {
        // Of two for the same number, the one that the fit itself states says more.
        let stated = record.next_measurement.take();
        let all = NextMeasurement::of(&record).into_iter().chain(stated);
        record.next_measurement = record.pass_first(all.max_by(|a, b| a.error_now.total_cmp(&b.error_now)));
        self.times.total_s = self.clock.elapsed().as_secs_f64();
        self.times.peak_memory_mib = peak_memory_mib();
        self.times.write(&self.out)?;
        record.write(&self.out)?;
        if let Some(parts) = self.parts.get() {
            // Parts that cannot be removed do no harm in a complete fit.
            let _ = std::fs::remove_dir_all(parts);
        }
        Ok(Box::new(record))
    }
}

/// Ending of the file of a part that is written last.
const PART: &str = ".part.toml";

/// Largest amount of memory of this process so far (MiB), where the system tells.
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kb| kb / 1024.0)
}
