//! Files that are whole or absent.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::parents::Parents;
use super::partial::{Partial, SUFFIX, explain};

/// The path of a file that will be written later, after long work: known to be writable before the work begins.
///
/// Its missing folders are created; dropped, it removes those of them that are still empty.
#[derive(Debug)]
pub struct ReservedPath {
    _parents: Parents,
}

impl ReservedPath {
    /// Creates the missing folders of `path` and tries to write there, leaving no trace but those.
    ///
    /// # Errors
    ///
    /// The file could not be written; the message names it and, where one is known, a remedy.
    pub fn new(path: &Path) -> io::Result<Self> {
        let place = || {
            let (path, dir, prefix) = target_of(path)?;
            if path.is_dir() {
                return Err(io::ErrorKind::IsADirectory.into());
            }
            let parents = Parents::create(&dir)?;
            tempfile::Builder::new().prefix(&prefix).suffix(SUFFIX).tempfile_in(&dir)?;
            Ok(Self { _parents: parents })
        };
        place().map_err(|e| explain(path, &e))
    }
}

/// Writes a file through `f` so that `path` holds either the whole new content or what it held before.
///
/// The content goes to a temporary file in the same folder, which is renamed into place when `f` has succeeded and
/// removed when anything fails (a full disk, say). Nothing is forced to the disk: a power cut may still lose the file.
///
/// # Errors
///
/// Whatever `f` or the file system reports; the message names `path` and, where one is known, a remedy.
pub fn write_atomic(path: &Path, f: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    write_whole(path, f).map_err(|e| explain(path, &e))
}

fn write_whole(path: &Path, f: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut file = AtomicFile::start(path)?;
    f(&mut file)?;
    file.put_in_place()
}

/// A file under construction, for content that comes bit by bit: what [`write_atomic`] does, in three steps. Dropped
/// before [`AtomicFile::commit`], it leaves `path` as it was.
#[derive(Debug)]
pub struct AtomicFile {
    target: PathBuf,
    temp: BufWriter<tempfile::NamedTempFile>,
    _partial: Partial,
}

impl AtomicFile {
    /// Starts the file `path`, in its folder, which must exist.
    ///
    /// # Errors
    ///
    /// The file system refuses; the message names `path` and, where one is known, a remedy.
    pub fn create(path: &Path) -> io::Result<Self> {
        Self::start(path).map_err(|e| explain(path, &e))
    }

    fn start(path: &Path) -> io::Result<Self> {
        let (target, dir, prefix) = target_of(path)?;
        remove_abandoned(&dir, &prefix);
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(SUFFIX);
        // A temporary file is private by default; a result should be as readable as any other file (less the umask).
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let temp = loop {
            let temp = builder.tempfile_in(&dir)?;
            // The lock says that somebody is at work on it, and the system takes it back however he ends. Not every
            // disk has locks; there, what a killed run left stays.
            let locked = temp.as_file().lock();
            // Between its creation and the lock another run may have taken it for abandoned.
            if locked.is_err() || temp.path().exists() {
                break temp;
            }
        };
        let partial = Partial::new(temp.path(), &target);
        Ok(Self { target, temp: BufWriter::with_capacity(1 << 16, temp), _partial: partial })
    }

    /// Puts the file into place.
    ///
    /// # Errors
    ///
    /// The file system refuses; the file is then as it was.
    pub fn commit(self) -> io::Result<()> {
        let target = self.target.clone();
        self.put_in_place().map_err(|e| explain(&target, &e))
    }

    fn put_in_place(self) -> io::Result<()> {
        let temp = self.temp.into_inner().map_err(io::IntoInnerError::into_error)?;
        temp.persist(&self.target).map_err(|e| e.error)?;
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temp.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temp.flush()
    }
}

/// Removes what killed runs have left of the file whose temporary names begin with `prefix`: what nobody has locked.
fn remove_abandoned(dir: &Path, prefix: &str) {
    // The folder may be missing or unreadable; whoever writes there will say so.
    for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(middle) = name.to_str().and_then(|n| n.strip_prefix(prefix)?.strip_suffix(SUFFIX)) else { continue };
        // A dot in the middle: the file of a longer name.
        if middle.contains('.') || !entry.file_type().is_ok_and(|t| t.is_file()) {
            continue;
        }
        if let Ok(file) = fs::OpenOptions::new().write(true).open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Returns where a file goes in the end, its folder, and how its temporary name begins. Links are followed, so that
/// what they point to is replaced and not the link; devices and pipes are refused, for renaming would replace them.
fn target_of(path: &Path) -> io::Result<(PathBuf, PathBuf, String)> {
    let path = if path.exists() { path.canonicalize()? } else { path.to_path_buf() };
    let invalid = |problem| io::Error::new(io::ErrorKind::InvalidInput, problem);
    if path.exists() && !path.is_file() && !path.is_dir() {
        return Err(invalid("it is a device or pipe, not a file; choose another name"));
    }
    let name = path.file_name().ok_or_else(|| invalid("not a file name; choose another"))?;
    let prefix = format!(".{}.", name.to_string_lossy());
    let dir = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
        _ => PathBuf::from("."),
    };
    Ok((path, dir, prefix))
}

#[cfg(test)]
mod tests {
    use super::super::names;
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_other() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_atomic(&path, |w| w.write_all(b"first")).unwrap();
        let e = write_atomic(&path, |w| {
            w.write_all(&[0; 100_000])?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert_eq!(e.kind(), io::ErrorKind::StorageFull);
        assert!(e.to_string().contains("a.txt") && e.to_string().contains("free space"), "{e}");
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(names(dir.path()), ["a.txt"]);
    }

    /// What a killed run left goes when the file is written again; what a running one has in hand stays, and so do
    /// other files' parts.
    #[test]
    fn abandoned_parts_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let mut live = AtomicFile::create(&path).unwrap();
        for name in [".a.png.Xy12z3.partial", ".a.png.b.Xy12z3.partial", ".b.png.Xy12z3.partial", ".a.png.Xy12z3"] {
            fs::write(dir.path().join(name), "half").unwrap();
        }
        write_atomic(&path, |w| w.write_all(b"first")).unwrap();
        live.write_all(b"second").unwrap();
        live.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(names(dir.path()), [".a.png.Xy12z3", ".a.png.b.Xy12z3.partial", ".b.png.Xy12z3.partial", "a.png"]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("no/such/a.txt");
        let e = write_atomic(&path, |_| Ok(())).unwrap_err();
        assert!(e.to_string().contains("a.txt") && e.to_string().contains("create its folder"), "{e}");
    }

    #[cfg(unix)]
    #[test]
    fn files_are_not_private() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let (plain, atomic) = (dir.path().join("plain"), dir.path().join("atomic"));
        fs::write(&plain, b"x").unwrap();
        write_atomic(&atomic, |w| w.write_all(b"x")).unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&plain), mode(&atomic));
    }

    #[test]
    fn a_place_is_tried_and_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("fields/new/a.txt");
        let place = ReservedPath::new(&path).unwrap();
        assert!(names(path.parent().unwrap()).is_empty());
        drop(place);
        assert!(names(dir.path()).is_empty());
        let place = ReservedPath::new(&path).unwrap();
        write_atomic(&path, |w| w.write_all(b"x")).unwrap();
        drop(place);
        assert_eq!(fs::read(&path).unwrap(), b"x");

        let e = ReservedPath::new(&path.join("b.txt")).unwrap_err().to_string();
        assert!(e.contains("a.txt/b.txt") && e.contains("choose another"), "{e}");
        let e = ReservedPath::new(dir.path()).unwrap_err().to_string();
        assert!(e.contains("choose another name"), "{e}");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_kept() {
        let dir = tempfile::tempdir().unwrap();
        let (file, link) = (dir.path().join("file"), dir.path().join("link"));
        fs::write(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_atomic(&link, |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(link.is_symlink());
        // A socket stands for the device: replacing it would harm nobody should this test fail.
        let socket = dir.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let e = write_atomic(&socket, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(e.contains("socket") && e.contains("choose another name"), "{e}");
        assert!(ReservedPath::new(&socket).is_err() && socket.exists() && !socket.is_file());
    }
}
