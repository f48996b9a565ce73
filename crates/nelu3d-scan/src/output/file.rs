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
