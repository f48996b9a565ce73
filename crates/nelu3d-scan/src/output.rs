//! Files and folders that are either whole or absent: written under a temporary name beside their place, then renamed.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// What is under construction in this process: files and folders under their temporary names.
static PARTIAL: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Notes a temporary name until it is dropped, for [`remove_partial`].
#[derive(Debug)]
struct Partial(PathBuf);

impl Partial {
    fn new(path: &Path) -> Self {
        PARTIAL.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_path_buf());
        Self(path.to_path_buf())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        PARTIAL.lock().unwrap_or_else(PoisonError::into_inner).retain(|p| *p != self.0);
    }
}

/// Removes everything that this process has under construction: for a program that ends on the spot, without unwinding.
/// Work that goes on in other threads will fail to write.
pub fn remove_partial() {
    for path in PARTIAL.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
    }
}

/// The path of a file that will be written later, after long work: known to be writable before the work begins.
///
/// Its missing folders are created; dropped, it removes those of them that are still empty.
#[derive(Debug)]
pub struct ReservedPath {
    _folders: Folders,
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
            let folders = Folders::create(&dir)?;
            tempfile::Builder::new().prefix(&prefix).suffix(SUFFIX).tempfile_in(&dir)?;
            Ok(Self { _folders: folders })
        };
        place().map_err(|e| explain(path, &e))
    }
}

/// Folders created on the way to an output, outermost first. Those that are still empty when it is dropped are removed.
#[derive(Debug)]
struct Folders(Vec<PathBuf>);

impl Folders {
    fn create(dir: &Path) -> io::Result<Self> {
        let missing = |d: &&Path| !d.as_os_str().is_empty() && !d.exists();
        let mut folders = Self(dir.ancestors().take_while(missing).map(Path::to_path_buf).collect());
        folders.0.reverse();
        // The system would only say that something exists.
        let above = dir.ancestors().find(|d| d.exists());
        if above.is_some_and(|d| !d.is_dir()) {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        fs::create_dir_all(dir)?;
        Ok(folders)
    }
}

impl Drop for Folders {
    fn drop(&mut self) {
        for dir in self.0.iter().rev() {
            // Fails, as it should, for a folder that holds something.
            let _ = fs::remove_dir(dir);
        }
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

/// Creates a folder and its parents, if it is not there.
///
/// # Errors
///
/// The file system refuses; the message names `path` and, where one is known, a remedy.
pub fn create_dir(path: &Path) -> io::Result<()> {
    fs::create_dir_all(path).map_err(|e| explain(path, &e))
}

/// Gives the file `from` a second name, without a copy. Where the disk has no such thing, or is another, it is copied.
///
/// # Errors
///
/// `from` cannot be read or `to` not written; the message names both.
pub fn link_or_copy(from: &Path, to: &Path) -> io::Result<()> {
    // The link itself would be linked, and may be relative.
    let from = fs::canonicalize(from)?;
    if fs::hard_link(&from, to).is_ok() {
        return Ok(());
    }
    fs::copy(&from, to).map(|_| ()).map_err(|e| {
        io::Error::new(e.kind(), format!("{}: cannot be copied from {}: {e}", to.display(), from.display()))
    })
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
        let partial = Partial::new(temp.path());
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

/// How the names of files under construction end.
const SUFFIX: &str = ".partial";

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

/// Returns an error with the path and a remedy in its message.
fn explain(path: &Path, e: &io::Error) -> io::Error {
    let remedy = match e.kind() {
        io::ErrorKind::NotFound => "; create its folder first",
        io::ErrorKind::PermissionDenied => "; choose a folder you may write to, or change its permissions",
        io::ErrorKind::ReadOnlyFilesystem => "; choose a folder on a writable disk",
        io::ErrorKind::StorageFull => "; free space on that disk, or write to another",
        io::ErrorKind::QuotaExceeded => "; free some of your quota on that disk, or write to another",
        io::ErrorKind::IsADirectory => "; a folder has this name: move it away, or choose another name",
        io::ErrorKind::NotADirectory => "; a part of this path is a file, not a folder: choose another path",
        _ => "",
    };
    io::Error::new(e.kind(), format!("{}: cannot be written: {e}{remedy}", path.display()))
}

/// A folder of results under construction. It is built under a temporary name beside its place (`.NAME.partial-PID`),
/// put into place by [`OutputDir::commit`], and removed when dropped before that.
#[derive(Debug)]
pub struct OutputDir {
    target: PathBuf,
    temp: PathBuf,
    committed: bool,
    // Dropped after the temporary folder has been removed, in this order.
    _partial: Partial,
    _folders: Folders,
}

impl OutputDir {
    /// Starts the folder `target`, creating its parents. An existing `target` is replaced at [`OutputDir::commit`], but
    /// only if it is empty or holds a file named `marker` (as `result.json`): proof that it is an earlier result and
    /// not a folder of somebody's own files.
    ///
    /// # Errors
    ///
    /// `target` exists and is not an earlier result, or its parent cannot be written to.
    pub fn create(target: &Path, marker: &str) -> io::Result<Self> {
        Self::start(target, marker).map_err(|e| explain(target, &e))
    }

    fn start(target: &Path, marker: &str) -> io::Result<Self> {
        // A link is followed, so that what it points to is replaced and not the link.
        let target = if target.exists() { target.canonicalize()? } else { target.to_path_buf() };
        let Some(name) = target.file_name() else {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "not the name of a folder; choose another"));
        };
        if target.exists() {
            if !target.is_dir() {
                let problem = "a file of this name exists; remove it, or choose another name";
                return Err(io::Error::new(io::ErrorKind::AlreadyExists, problem));
            }
            if !target.join(marker).is_file() && fs::read_dir(&target)?.next().is_some() {
                let problem = format!(
                    "the folder exists and is not an earlier result (it has no {marker}); choose another folder, or \
                     delete it yourself"
                );
                return Err(io::Error::new(io::ErrorKind::AlreadyExists, problem));
            }
        }
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let folders = Folders::create(&parent)?;
        let temp = create_sibling(&parent, &name.to_string_lossy(), "partial")?;
        let partial = Partial::new(&temp);
        Ok(Self { target, temp, committed: false, _partial: partial, _folders: folders })
    }

    /// Returns where to write the files of the folder until it is committed.
    pub fn path(&self) -> &Path {
        &self.temp
    }

    /// Returns where the folder will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Puts the folder into place, replacing an earlier result. The earlier one is moved aside first and put back if
    /// the new one cannot take its place, so at every moment one of the two is whole.
    ///
    /// # Errors
    ///
    /// The file system refuses; the folder under construction is then removed.
    pub fn commit(mut self) -> io::Result<()> {
        self.put_in_place().map_err(|e| explain(&self.target, &e))
    }

    fn put_in_place(&mut self) -> io::Result<()> {
        if !self.target.exists() {
            fs::rename(&self.temp, &self.target)?;
            self.committed = true;
            return Ok(());
        }
        let parent = self.temp.parent().expect("made inside a folder").to_path_buf();
        let name = self.target.file_name().expect("checked at the start").to_string_lossy().into_owned();
        let aside = create_sibling(&parent, &name, "old")?;
        let old = aside.join("previous");
        let swapped = fs::rename(&self.target, &old).and_then(|()| {
            fs::rename(&self.temp, &self.target).inspect_err(|_| {
                // Nothing better is left to do if even this fails: the earlier result then stays in `aside`.
                let _ = fs::rename(&old, &self.target);
            })
        });
        match swapped {
            Ok(()) => {
                self.committed = true;
                fs::remove_dir_all(&aside)
            }
            Err(e) => {
                // Removes `aside` only if it is empty, that is, if the earlier result is back in its place.
                let _ = fs::remove_dir(&aside);
                Err(e)
            }
        }
    }
}

impl Drop for OutputDir {
    fn drop(&mut self) {
        if !self.committed {
            let _ = fs::remove_dir_all(&self.temp);
        }
    }
}

/// Creates the hidden folder `.NAME.KIND-PID` in `parent`, with a counter where a killed run has left that name behind.
fn create_sibling(parent: &Path, name: &str, kind: &str) -> io::Result<PathBuf> {
    let pid = std::process::id();
    for i in 0..1000 {
        let suffix = if i == 0 { String::new() } else { format!("-{i}") };
        let dir = parent.join(format!(".{name}.{kind}-{pid}{suffix}"));
        match fs::create_dir(&dir) {
            Ok(()) => return Ok(dir),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
    Err(io::Error::new(io::ErrorKind::AlreadyExists, format!("remove the old folders .{name}.{kind}-* beside it")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut all: Vec<_> =
            fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        all.sort();
        all
    }

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
    fn a_folder_appears_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("results/pawn");
        let out = OutputDir::create(&target, "result.json").unwrap();
        fs::write(out.path().join("result.json"), "1").unwrap();
        assert!(!target.exists());
        drop(out);
        assert!(names(dir.path()).is_empty());

        for content in ["2", "3"] {
            let out = OutputDir::create(&target, "result.json").unwrap();
            fs::write(out.path().join("result.json"), content).unwrap();
            fs::write(out.path().join(content), "").unwrap();
            out.commit().unwrap();
            assert_eq!(fs::read_to_string(target.join("result.json")).unwrap(), content);
            assert_eq!(names(&target), [content, "result.json"]);
            assert_eq!(names(&dir.path().join("results")), ["pawn"]);
        }
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

    #[test]
    fn what_is_under_construction_is_removed_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let out = OutputDir::create(&dir.path().join("result"), "result.json").unwrap();
        fs::write(out.path().join("depth.npy"), "half").unwrap();
        let noted = PARTIAL.lock().unwrap().clone();
        assert!(noted.iter().any(|p| p == out.path()));
        drop(out);
        assert!(!PARTIAL.lock().unwrap().iter().any(|p| p.starts_with(dir.path())));
    }

    #[test]
    fn somebody_elses_folder_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("thesis.tex"), "years").unwrap();
        let e = OutputDir::create(dir.path(), "result.json").unwrap_err();
        assert!(e.to_string().contains("choose another folder"), "{e}");
        let e = OutputDir::create(&dir.path().join("thesis.tex"), "result.json").unwrap_err();
        assert!(e.to_string().contains("a file of this name exists"), "{e}");
        assert_eq!(names(dir.path()), ["thesis.tex"]);
    }
}
