//! Where a path leads, and whether two paths lead to one file.

use crate::atomic;
use std::path::{Component, Path, PathBuf};

/// Whether two names are one file: the same place, or hard links to it. Standard input is a file where the shell
/// redirects one.
pub(super) fn same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let b = if b == Path::new("-") { Path::new("/dev/stdin") } else { b };
        let place = |m: &std::fs::Metadata| (m.dev(), m.ino());
        matches!((std::fs::metadata(a), std::fs::metadata(b)), (Ok(a), Ok(b)) if a.is_file() && place(&a) == place(&b))
    }
    #[cfg(not(unix))]
    {
        matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b && a.is_file())
    }
}

/// The absolute place of a path, which need not exist. Links are followed as far as the path exists; `.` and `..` are
/// resolved.
pub fn resolved(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let path = atomic::through_links(&path);
    for base in path.ancestors() {
        if let (Ok(real), Ok(rest)) = (base.canonicalize(), path.strip_prefix(base)) {
            return rest.components().fold(real, |at, part| match part {
                Component::ParentDir => at.parent().map(Path::to_path_buf).unwrap_or(at),
                Component::CurDir => at,
                name => at.join(name),
            });
        }
    }
    path
}
