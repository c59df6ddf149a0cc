//! Locks of output folders: two runs never write one folder at once.
//!
//! The lock is the operating system's own, on the folder itself: it leaves no file, and it ends with the program, however
//! that ends. Where the file system has no locks (some network file systems), nothing is refused.

use super::resolved;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Who else may write a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// Nobody.
    Alone,
    /// Other shards of one fit.
    Shared,
}

/// Folders that this program has locked.
static HELD: Mutex<BTreeMap<PathBuf, File>> = Mutex::new(BTreeMap::new());

fn held() -> MutexGuard<'static, BTreeMap<PathBuf, File>> {
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Locks the folder `place`, if it exists and this program has not locked it already.
///
/// # Errors
/// [`Error::Usage`] where another run has it.
pub(super) fn take(place: &Path, with: Use) -> Result<()> {
    let mut held = held();
    // A folder can be opened like a file on Unix only; elsewhere only the files in it are locked.
    let Ok(folder) = File::open(place) else { return Ok(()) };
    if held.contains_key(place) || !place.is_dir() {
        return Ok(());
    }
    let locked = if with == Use::Alone { folder.try_lock() } else { folder.try_lock_shared() };
    match locked {
        Ok(()) => drop(held.insert(place.to_path_buf(), folder)),
        Err(TryLockError::Error(_)) => {}
        Err(TryLockError::WouldBlock) => {
            let what = "is being written by another run; wait until it has ended, or name another folder";
            return Err(Error::Usage(format!("the output folder {} {what}", place.display())));
        }
    }
    Ok(())
}

/// Waits until no other shard uses the folder, and keeps it from them until [`release`].
pub fn alone(folder: &Path) {
    // The list of locks is free while this waits.
    let file = held().get(&resolved(folder)).and_then(|file| file.try_clone().ok());
    if let Some(file) = file {
        // Without locks there is nobody to wait for.
        let _ = file.lock();
    }
}

/// Lets other runs have a folder that this one has claimed.
pub fn release(folder: &Path) {
    held().remove(&resolved(folder));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn a_folder_is_one_runs_alone_or_shared_by_shards() {
        let dir = tempfile::tempdir().unwrap();
        let place = resolved(dir.path());
        // Locks are of an opened folder, so a second opening stands for another program.
        let other = File::open(&place).unwrap();
        other.lock_shared().unwrap();
        let refused = take(&place, Use::Alone).unwrap_err();
        assert!(refused.is_usage() && refused.to_string().contains("written by another run"), "{refused}");
        take(&place, Use::Shared).unwrap();
        let waits = std::thread::spawn({
            let place = place.clone();
            move || alone(&place)
        });
        other.unlock().unwrap();
        waits.join().unwrap();
        assert!(matches!(other.try_lock_shared(), Err(TryLockError::WouldBlock)));
        release(&place);
        other.try_lock().unwrap();
        assert!(take(&place, Use::Shared).is_err());
    }
}
