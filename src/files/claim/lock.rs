//! Locks of output folders: two runs never write one folder at once, nor do two threads of one program.
//!
//! The lock is the operating system's own, on the folder itself: it leaves no file, and it ends with the program,
//! however that ends. Where folders cannot be locked (on Windows, on some network file systems), nothing is refused.

use super::resolved;
use crate::atomic::same;
use crate::progress::{go_on, say};
use crate::{Error, Result};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time between two looks at a lock that somebody else has.
const EVERY: Duration = Duration::from_millis(20);

/// Who else may write a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClaimMode {
    /// Nobody.
    Alone,
    /// Other shards of one fit.
    Shared,
}

/// An output folder that is claimed. It is free again when this value is dropped.
#[derive(Debug)]
#[must_use = "the folder is free again as soon as this is dropped"]
pub struct FolderClaim {
    place: PathBuf,
    /// The opened folder, which has the lock; nothing where there is no lock.
    locked: Option<File>,
}

impl FolderClaim {
    /// Locks the folder `place`, if it exists. A shard waits for a run that has it alone.
    ///
    /// # Errors
    /// [`Error::Usage`] where somebody else has it, [`Error::Interrupted`] after a stop while it waits.
    pub(super) fn take(place: &Path, with: ClaimMode) -> Result<Self> {
        let claim = |locked| Ok(FolderClaim { place: place.to_path_buf(), locked });
        // A folder can be opened like a file on Unix only; elsewhere only the files in it are locked.
        let Some(folder) = place.is_dir().then(|| File::open(place).ok()).flatten() else { return claim(None) };
        let tried = match with {
            ClaimMode::Alone => folder.try_lock(),
            ClaimMode::Shared => once_free(place, || folder.try_lock_shared())?,
        };
        match tried {
            // The folder may have been removed, by the run that made it, before it was locked.
            Ok(()) if same(&folder, place) => claim(Some(folder)),
            Ok(()) | Err(TryLockError::Error(_)) => claim(None),
            Err(TryLockError::WouldBlock) => {
                let what = "is being written by another run; wait until it has ended, or name another folder";
                Err(Error::Usage(format!("the output folder {} {what}", place.display())))
            }
        }
    }

    /// Whether the folder is locked. A folder that does not exist yet is not.
    pub(super) fn is_locked(&self) -> bool {
        self.locked.is_some()
    }

    /// Waits until no other shard uses the folder, and keeps it from them from then on.
    ///
    /// # Errors
    /// [`Error::Interrupted`] after a stop.
    pub fn alone(&self) -> Result<()> {
        let Some(folder) = &self.locked else { return Ok(()) };
        // Of two shards that wait here, neither may hold what the other one waits for.
        let _ = folder.unlock();
        // Without locks there is nobody to wait for.
        let _ = once_free(&self.place, || folder.try_lock())?;
        Ok(())
    }
}

impl Drop for FolderClaim {
    fn drop(&mut self) {
        // To close the file would not be enough where a child process has inherited it.
        let _ = self.locked.as_ref().map(File::unlock);
    }
}

/// Removes the folders that a run made for its output, innermost first, as far as they are empty. `claim` is what the
/// run has claimed. Nothing is removed while anybody else has claimed the innermost one.
pub fn undo(made: &[PathBuf], claim: Option<&FolderClaim>) {
    let Some(folder) = made.first() else { return };
    // A run that was refused asks for the lock once more, because the folder may be somebody else's by now.
    let own = if claim.is_none() { FolderClaim::take(&resolved(folder), ClaimMode::Alone).ok() } else { None };
    let Some(claim) = claim.or(own.as_ref()) else { return };
    if claim.locked.as_ref().is_none_or(|file| !matches!(file.try_lock(), Err(TryLockError::WouldBlock))) {
        made.iter().take_while(|folder| std::fs::remove_dir(folder).is_ok()).for_each(drop);
    }
}

/// What `attempt` gives as soon as nobody else has the folder. Says once that it waits.
fn once_free(
    place: &Path,
    attempt: impl Fn() -> std::result::Result<(), TryLockError>,
) -> Result<std::result::Result<(), TryLockError>> {
    let mut tried = attempt();
    if matches!(tried, Err(TryLockError::WouldBlock)) {
        say(format!("waiting for another run that writes {}", place.display()));
    }
    while matches!(tried, Err(TryLockError::WouldBlock)) {
        go_on()?;
        std::thread::sleep(EVERY);
        tried = attempt();
    }
    Ok(tried)
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::mpsc;

    #[test]
    fn a_folder_is_one_runs_alone_or_shared_by_shards() {
        let dir = tempfile::tempdir().unwrap();
        let place = resolved(dir.path());
        let first = FolderClaim::take(&place, ClaimMode::Alone).unwrap();
        // Every claim is refused, and none of those that are refused frees the folder.
        for _ in 0..2 {
            let refused = FolderClaim::take(&place, ClaimMode::Alone).unwrap_err();
            assert!(refused.is_usage() && refused.to_string().contains("written by another run"), "{refused}");
        }
        drop(first);
        let shards = [ClaimMode::Shared; 2].map(|with| FolderClaim::take(&place, with).unwrap());
        assert!(FolderClaim::take(&place, ClaimMode::Alone).is_err());
        drop(shards);
        assert!(FolderClaim::take(&place, ClaimMode::Alone).unwrap().is_locked());
        assert!(!FolderClaim::take(&place.join("absent"), ClaimMode::Alone).unwrap().is_locked());
    }

    #[test]
    fn a_shard_waits_until_the_others_have_ended() {
        let dir = tempfile::tempdir().unwrap();
        let place = resolved(dir.path());
        let [one, other] = [ClaimMode::Shared; 2].map(|with| FolderClaim::take(&place, with).unwrap());
        let ended = AtomicBool::new(false);
        std::thread::scope(|threads| {
            let (begins, begun) = mpsc::channel();
            let ended = &ended;
            threads.spawn(move || {
                begins.send(()).unwrap();
                one.alone().unwrap();
                assert!(ended.load(Ordering::SeqCst), "it did not wait");
            });
            begun.recv().unwrap();
            ended.store(true, Ordering::SeqCst);
            drop(other);
        });
        // A shard that comes while the folder is one run's alone tries again until it is free.
        let left = Cell::new(3);
        let busy = || match left.replace(left.get() - 1) {
            0 => Ok(()),
            _ => Err(TryLockError::WouldBlock),
        };
        assert!(once_free(&place, busy).unwrap().is_ok());
    }

    #[test]
    fn a_new_folder_is_removed_by_its_run_alone() {
        let dir = tempfile::tempdir().unwrap();
        let made = ["new/deeper", "new"].map(|name| dir.path().join(name));
        std::fs::create_dir_all(&made[0]).unwrap();
        let place = resolved(&made[0]);
        let [mine, other] = [ClaimMode::Shared; 2].map(|with| FolderClaim::take(&place, with).unwrap());
        undo(&made, None);
        undo(&made, Some(&mine));
        assert!(made[0].exists(), "another shard has it");
        drop(other);
        undo(&made, Some(&mine));
        assert!(!made[1].exists());
    }
}
