//! Writes files completely or not at all: under a temporary name beside the target, followed by a rename.
//!
//! The temporary name of `FILE` is `.FILE.partial`, and who writes it holds a lock on it. So two runs never write one
//! file at once, and what a killed run left is recognised, because nobody holds its lock, and replaced by the next run.

use crate::{Error, Result};
use std::collections::BTreeSet;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

/// How often a temporary file is made anew that other runs removed just after it was made.
const TRIES: usize = 16;

/// Writes `path` through `fill`. The name appears only when everything is on disk.
///
/// # Errors
/// Naming `path`: [`Error::Usage`] when nothing can be written there, [`Error::Write`] when the disk is full; the
/// temporary file is removed.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let mut pending = PendingFile::create(path)?;
    fill(&mut pending).map_err(|e| Error::write(path, explain(&e)))?;
    pending.finish()
}

/// [`write`] for bytes in hand.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write(path, |w| w.write_all(bytes))
}

/// A file that is written under a temporary name; [`PendingFile::finish`] gives it its own name. Devices and pipes
/// (`/dev/null`, a FIFO) are written in place, because a rename would replace them. For a symbolic link, the file that
/// it leads to is written, and the link stays. A new file gets the mode that the umask leaves; a replaced file keeps
/// its mode.
#[derive(Debug)]
pub struct PendingFile {
    target: Option<Target>,
    /// The name that was asked for.
    path: PathBuf,
    /// The file that it leads to.
    real: PathBuf,
}

/// Temporary files that are being written.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the temporary files that are being written, for a program that ends in the middle of its work. What is
/// written to them later is lost.
pub fn remove_unfinished() {
    remove_those(|_| true);
}

/// Removes the temporary files of these paths.
fn remove_those(which: impl Fn(&Path) -> bool) {
    for _ in 0..100 {
        // Where memory ended while this very thread held the list, nobody frees it.
        let list = match UNFINISHED.try_lock() {
            Ok(list) => list,
            Err(TryLockError::Poisoned(list)) => list.into_inner(),
            Err(TryLockError::WouldBlock) => {
                std::thread::sleep(Duration::from_millis(1));
                continue;
            }
        };
        // A file that was finished just now has its own name already.
        return list.iter().filter(|path| which(path)).for_each(|path| drop(fs::remove_file(path)));
    }
}

#[derive(Debug)]
enum Target {
    Temporary(BufWriter<tempfile::NamedTempFile>),
    InPlace(BufWriter<fs::File>),
}

impl PendingFile {
    /// Opens a temporary file in the folder of `path` (created if missing).
    ///
    /// # Errors
    /// [`Error::Usage`] where no file can be made (a folder of that name, a read-only place, another run that writes
    /// it), [`Error::Write`] for a full disk.
    pub fn create(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return Err(Error::Usage(format!("{}: found a folder, expected the name of a file", path.display())));
        }
        let real = through_links(path);
        let target = if fs::metadata(path).is_ok_and(|m| !m.is_file()) {
            let file = fs::OpenOptions::new().write(true).open(path).map_err(|e| unopened(path, &e))?;
            Target::InPlace(BufWriter::new(file))
        } else {
            Target::Temporary(
                Self::temporary(&real).map_err(|(at, e)| unopened(if at == real { path } else { &at }, &e))?,
            )
        };
        Ok(PendingFile { target: Some(target), path: path.to_path_buf(), real })
    }

    /// A temporary file beside `path`. Where that fails, returns the place and the reason.
    fn temporary(path: &Path) -> std::result::Result<BufWriter<tempfile::NamedTempFile>, (PathBuf, io::Error)> {
        let here = |e| (path.to_path_buf(), e);
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        fs::create_dir_all(folder).map_err(|e| (folder.to_path_buf(), e))?;
        // Renaming would replace a file that its owner has made read-only.
        let old = match fs::OpenOptions::new().write(true).open(path) {
            Ok(file) => Some(file.metadata().map_err(here)?.permissions()),
            Err(e) if e.kind() == io::ErrorKind::NotFound => None,
            Err(e) => return Err(here(e)),
        };
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let file = locked(&format!(".{name}"), folder).map_err(here)?;
        if let Some(mode) = old {
            file.as_file().set_permissions(mode).map_err(here)?;
        }
        unfinished().insert(file.path().to_path_buf());
        Ok(BufWriter::with_capacity(1 << 16, file))
    }

    /// Flushes to the disk and renames. Without this call the temporary file is removed on drop.
    pub fn finish(mut self) -> Result<()> {
        match self.target.take() {
            Some(Target::Temporary(writer)) => {
                unfinished().remove(writer.get_ref().path());
                let temp = writer.into_inner().map_err(|e| Error::write(&self.path, explain(e.error())))?;
                // Otherwise the name could be on the disk before what it names, and a machine that loses its power then
                // would keep an empty file.
                match temp.as_file().sync_all() {
                    // Some network file systems cannot do it.
                    Err(e) if !matches!(e.kind(), io::ErrorKind::Unsupported | io::ErrorKind::InvalidInput) => {
                        return Err(Error::write(&self.path, explain(&e)));
                    }
                    _ => {}
                }
                temp.persist(&self.real).map_err(|e| Error::write(&self.path, explain(&e.error)))?;
                Ok(())
            }
            Some(Target::InPlace(mut writer)) => writer.flush().map_err(|e| Error::write(&self.path, explain(&e))),
            None => Ok(()),
        }
    }

    fn with<T>(&mut self, act: impl FnOnce(&mut dyn WriteSeek) -> io::Result<T>) -> io::Result<T> {
        match &mut self.target {
            Some(Target::Temporary(w)) => act(w),
            Some(Target::InPlace(w)) => act(w),
            None => Err(io::Error::other("already finished")),
        }
    }
}

/// The temporary file `NAME.partial` in `folder`, locked. One that a killed run left is removed first.
///
/// # Errors
/// [`io::ErrorKind::WouldBlock`] while another run writes it.
fn locked(name: &str, folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let path = folder.join(format!("{name}.partial"));
    for _ in 0..TRIES {
        match temporary(name, 0, folder) {
            Ok(file) => match file.as_file().try_lock() {
                // Another run may have taken the file for a rest, and removed it, before it was locked.
                Ok(()) if same(file.as_file(), &path) => return Ok(file),
                Ok(()) | Err(fs::TryLockError::WouldBlock) => drop(file.into_temp_path().keep()),
                // A file system without locks.
                Err(fs::TryLockError::Error(_)) => return Ok(file),
            },
            // To open a pipe would wait for its other end. What is no file is none of ours: it stays.
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && is_other(&path) => {
                return temporary(&format!("{name}."), 6, folder);
            }
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => match fs::File::open(&path) {
                Ok(rest) => match rest.try_lock() {
                    Ok(()) if same(&rest, &path) => fs::remove_file(&path)?,
                    Ok(()) => {}
                    Err(fs::TryLockError::WouldBlock) => return Err(io::ErrorKind::WouldBlock.into()),
                    Err(fs::TryLockError::Error(_)) => return temporary(&format!("{name}."), 6, folder),
                },
                Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                Err(e) => return Err(e),
            },
            Err(e) => return Err(e),
        }
    }
    Err(io::ErrorKind::WouldBlock.into())
}

/// Whether `path` names something, but no file: a folder, a pipe, a link.
fn is_other(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|m| !m.is_file())
}

/// Whether `path` is still the name of `file`.
pub(crate) fn same(file: &fs::File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        matches!((file.metadata(), fs::metadata(path)), (Ok(a), Ok(b)) if (a.dev(), a.ino()) == (b.dev(), b.ino()))
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        path.exists()
    }
}

/// A temporary file in `folder`, `NAME.partial` with so many random letters after the name, and with the mode that the
/// umask leaves a new file. (The crate's own default is private, 0600.)
fn temporary(name: &str, letters: usize, folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(name).suffix(".partial").rand_bytes(letters);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// The path that a name leads to. A symbolic link is followed, even to a file that does not exist yet. A link that
/// leads in a circle is left as it is.
pub(crate) fn through_links(path: &Path) -> PathBuf {
    let mut at = path.to_path_buf();
    for _ in 0..40 {
        match fs::read_link(&at) {
            Ok(next) => at = at.parent().map_or_else(|| next.clone(), |folder| folder.join(&next)),
            Err(_) => return at,
        }
    }
    path.to_path_buf()
}

/// A place where nothing can be written is a mistake on the command line; a full disk is not.
fn unopened(path: &Path, e: &io::Error) -> Error {
    if is_full(e) {
        return Error::write(path, explain(e));
    }
    Error::Usage(format!("cannot write {}: {}", path.display(), explain(e)))
}

fn is_full(e: &io::Error) -> bool {
    matches!(e.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if let Some(Target::Temporary(writer)) = &self.target {
            unfinished().remove(writer.get_ref().path());
        }
    }
}

trait WriteSeek: Write + io::Seek {}
impl<T: Write + io::Seek> WriteSeek for T {}

impl Write for PendingFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.with(|w| w.write(buf))
    }
    fn flush(&mut self) -> io::Result<()> {
        self.with(|w| w.flush())
    }
}

impl io::Seek for PendingFile {
    fn seek(&mut self, pos: io::SeekFrom) -> io::Result<u64> {
        self.with(|w| w.seek(pos))
    }
}

/// Makes `folder` if needed and proves that it can be written before any long work starts.
///
/// # Errors
/// Naming the folder: [`Error::Usage`] (exit code 2), because a read-only output folder is the command line's mistake,
/// but [`Error::Write`] (1) for a full disk.
pub fn probe_folder(folder: &Path) -> Result<()> {
    let fail = |e: io::Error| unproved(folder, &e);
    fs::create_dir_all(folder).map_err(fail)?;
    match locked(".probe", folder) {
        // Another shard proves it just now.
        Err(e) if e.kind() == io::ErrorKind::WouldBlock => Ok(()),
        tried => tried.map(drop).map_err(fail),
    }
}

fn unproved(folder: &Path, e: &io::Error) -> Error {
    if is_full(e) {
        return Error::write(folder, explain(e));
    }
    let why = if folder.is_file() { "it is a file, expected a folder".into() } else { explain(e) };
    Error::Usage(format!("cannot write to the output folder {}: {why}", folder.display()))
}

/// An operating-system error in words, without its number.
pub fn explain(e: &io::Error) -> String {
    match e.kind() {
        io::ErrorKind::NotFound => "no such file or folder".into(),
        io::ErrorKind::PermissionDenied => "permission denied".into(),
        io::ErrorKind::StorageFull => "the disk is full".into(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only".into(),
        io::ErrorKind::FileTooLarge => "the file would exceed the largest size allowed".into(),
        io::ErrorKind::UnexpectedEof => "the file ends too early (truncated?)".into(),
        io::ErrorKind::IsADirectory => "found a folder, expected a file".into(),
        io::ErrorKind::NotADirectory => "a file stands where a folder is expected".into(),
        io::ErrorKind::WouldBlock => "another run is writing it; wait until it has ended".into(),
        io::ErrorKind::AlreadyExists => "something of this name is there already".into(),
        io::ErrorKind::InvalidData if e.to_string().contains("UTF-8") => {
            "found bytes that are not UTF-8, expected a text file".into()
        }
        _ => {
            let text = e.to_string();
            text.split(" (os error").next().unwrap_or(&text).to_string()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_bytes(&path, b"old").unwrap();
        let failed = write(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert!(failed.unwrap_err().to_string().contains("the disk is full"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn one_file_has_one_writer_and_a_rest_is_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        // What a killed run leaves: a file that nobody has locked.
        fs::write(dir.path().join(".a.txt.partial"), "a rest that is longer").unwrap();
        let mut first = PendingFile::create(&path).unwrap();
        let refused = PendingFile::create(&path).unwrap_err();
        assert!(refused.is_usage() && refused.to_string().contains("a.txt: another run is writing it"), "{refused}");
        first.write_all(b"first").unwrap();
        first.finish().unwrap();
        write_bytes(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_is_being_written_can_be_removed() {
        let dir = tempfile::tempdir().unwrap();
        let count = || fs::read_dir(dir.path()).unwrap().count();
        let mut half = PendingFile::create(&dir.path().join("half.txt")).unwrap();
        half.write_all(b"half").unwrap();
        write_bytes(&dir.path().join("whole.txt"), b"whole").unwrap();
        assert_eq!(count(), 2);
        // Other tests write at this moment, too.
        let own = fs::canonicalize(dir.path()).unwrap();
        remove_those(|path| path.starts_with(&own) || path.starts_with(dir.path()));
        assert_eq!(count(), 1);
        assert!(half.finish().is_err() && dir.path().join("whole.txt").exists());
    }

    #[test]
    fn errors_of_the_system_are_said_in_words() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.bin");
        fs::write(&file, [0xff, 0xfe, 0x00]).unwrap();
        let read = |path: &Path| explain(&fs::read_to_string(path).unwrap_err());
        assert_eq!(read(dir.path()), "found a folder, expected a file");
        assert_eq!(read(&file.join("b")), "a file stands where a folder is expected");
        assert_eq!(read(&file), "found bytes that are not UTF-8, expected a text file");
        assert_eq!(read(&dir.path().join("none")), "no such file or folder");
        let said = explain(&io::Error::from_raw_os_error(16));
        assert!(!said.contains("os error") && !said.is_empty(), "{said}");
        // A folder where a file should be, and a file where a folder should be, are mistakes on the command line.
        for error in [write_bytes(dir.path(), b"x").unwrap_err(), probe_folder(&file).unwrap_err()] {
            assert!(error.is_usage(), "{error}");
        }
        // A full disk is not.
        for kind in [io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded] {
            for said in [unopened(&file, &kind.into()), unproved(dir.path(), &kind.into())] {
                assert!(matches!(said, Error::Write { .. }), "{said}");
            }
        }
        assert!(unproved(dir.path(), &io::ErrorKind::PermissionDenied.into()).is_usage());
    }
}
