//! Files and folders that are either whole or absent: written under a temporary name beside their place, then renamed.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

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

fn write_whole(path: &Path, f: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "not a file name"))?;
    let dir = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let prefix = format!(".{}.", name.to_string_lossy());
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".partial");
    // A temporary file is private by default; a result should be as readable as any other file (less the umask).
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temp = builder.tempfile_in(dir)?;
    let mut w = BufWriter::with_capacity(1 << 16, temp);
    f(&mut w)?;
    let temp = w.into_inner().map_err(io::IntoInnerError::into_error)?;
    temp.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// The same error with the path and a remedy in its message.
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
        fs::create_dir_all(&parent)?;
        let temp = create_sibling(&parent, &name.to_string_lossy(), "partial")?;
        Ok(Self { target, temp, committed: false })
    }

    /// Where to write the files of the folder until it is committed.
    pub fn path(&self) -> &Path {
        &self.temp
    }

    /// Where the folder will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Puts the folder into place, replacing an earlier result. The earlier one is moved aside first and put back if the
    /// new one cannot take its place, so at every moment one of the two is whole.
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
        assert!(names(&dir.path().join("results")).is_empty());

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
