//! Folders of results that are whole or absent.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::parents::Parents;
use super::partial::{Partial, explain};
use super::swap::exchange;

/// What the name of a folder under construction says.
const PARTIAL: &str = "partial";
/// What the name of the folder says into which an earlier result is moved where folders cannot be exchanged.
const OLD: &str = "old";
/// Name of the earlier result in that folder.
const PREVIOUS: &str = "previous";

/// A folder of results under construction. It is built under a temporary name beside its place (`.NAME.partial-PID`),
/// put into place by [`OutputDir::commit`], and removed when dropped before that.
#[derive(Debug)]
pub struct OutputDir {
    target: PathBuf,
    marker: String,
    temp: PathBuf,
    committed: bool,
    /// Says that somebody is at work on the temporary folder; not every system and disk has such locks.
    _lock: Option<File>,
    // Dropped after the temporary folder has been removed, in this order.
    _partial: Partial,
    _parents: Parents,
}

impl OutputDir {
    /// Starts the folder `target`, creating its parents. An existing `target` is replaced at [`OutputDir::commit`], but
    /// only if it is empty or holds a file named `marker` (as `result.json`): proof that it is an earlier result and
    /// not a folder of somebody's own files.
    ///
    /// What killed runs have left of the same folder is removed, and an earlier result that one of them had moved aside
    /// is put back.
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
        let name = name.to_string_lossy();
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
            _ => PathBuf::from("."),
        };
        clean_up(&parent, &name, &target);
        check_replaceable(&target, marker)?;
        let parents = Parents::create(&parent)?;
        let (temp, lock) = create_sibling(&parent, &name, PARTIAL)?;
        let partial = Partial::new(&temp, &target);
        let marker = marker.to_owned();
        Ok(Self { target, marker, temp, committed: false, _lock: lock, _partial: partial, _parents: parents })
    }

    /// Returns where to write the files of the folder until it is committed.
    pub fn path(&self) -> &Path {
        &self.temp
    }

    /// Returns where the folder will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Puts the folder into place, replacing an earlier result. The two are exchanged in one step, so that at every
    /// moment one of them is there, whole. Where the system or the disk cannot do that, the earlier one is moved aside
    /// first; a run that is killed between the two steps leaves it there, and [`OutputDir::create`] puts it back.
    ///
    /// # Errors
    ///
    /// The file system refuses, or somebody has put something else there meanwhile; the folder under construction is
    /// then removed.
    pub fn commit(mut self) -> io::Result<()> {
        self.put_in_place().map_err(|e| explain(&self.target, &e))
    }

    fn put_in_place(&mut self) -> io::Result<()> {
        // Another run may put its result there, or take it away, between two steps: then they are tried again.
        const ATTEMPTS: usize = 100;
        for _ in 0..ATTEMPTS {
            check_replaceable(&self.target, &self.marker)?;
            match fs::rename(&self.temp, &self.target) {
                Ok(()) => {
                    self.committed = true;
                    return Ok(());
                }
                // A folder that holds something is in the way.
                Err(_) if self.target.exists() => {}
                Err(e) => return Err(e),
            }
            match exchange(&self.temp, &self.target) {
                Ok(true) => {
                    self.committed = true;
                    // The earlier result has the temporary name now. What cannot be removed goes with the next run.
                    let _ = fs::remove_dir_all(&self.temp);
                    return Ok(());
                }
                Ok(false) => return self.replace_in_two_steps(),
                Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                Err(e) => return Err(e),
            }
        }
        Err(io::Error::new(io::ErrorKind::ResourceBusy, "other runs write it over and over; choose another name"))
    }

    /// Moves the earlier result aside, and this one into its place: what [`OutputDir::commit`] does where folders
    /// cannot be exchanged, which no disk of the tests is like.
    ///
    /// # Errors
    ///
    /// The file system refuses, as it does where there is no earlier result.
    #[doc(hidden)]
    pub fn replace_in_two_steps(&mut self) -> io::Result<()> {
        let parent = self.temp.parent().expect("made inside a folder").to_path_buf();
        let name = self.target.file_name().expect("checked at the start").to_string_lossy().into_owned();
        let (aside, _lock) = create_sibling(&parent, &name, OLD)?;
        let old = aside.join(PREVIOUS);
        let swapped = fs::rename(&self.target, &old).and_then(|()| {
            fs::rename(&self.temp, &self.target).inspect_err(|_| {
                // Nothing better is left to do if even this fails: the next run tries again.
                let _ = fs::rename(&old, &self.target);
            })
        });
        if swapped.is_ok() {
            self.committed = true;
            let _ = fs::remove_dir_all(&aside);
        } else {
            // Removes `aside` only if it is empty, that is, if the earlier result is back in its place.
            let _ = fs::remove_dir(&aside);
        }
        swapped
    }
}

impl Drop for OutputDir {
    fn drop(&mut self) {
        if !self.committed {
            let _ = fs::remove_dir_all(&self.temp);
        }
    }
}

/// Fails if `target` is anything but missing, an empty folder, or an earlier result, which has a file named `marker`.
fn check_replaceable(target: &Path, marker: &str) -> io::Result<()> {
    let exists = |problem: String| Err(io::Error::new(io::ErrorKind::AlreadyExists, problem));
    if !target.exists() {
        return Ok(());
    }
    if !target.is_dir() {
        return exists("a file of this name exists; remove it, or choose another name".into());
    }
    if !target.join(marker).is_file() && fs::read_dir(target)?.next().is_some() {
        return exists(format!(
            "the folder exists and is not an earlier result (it has no {marker}); choose another folder, or delete it \
             yourself"
        ));
    }
    Ok(())
}

/// Creates the hidden folder `.NAME.KIND-PID` in `parent`, with a counter where that name is taken, and locks it if it
/// can be locked.
fn create_sibling(parent: &Path, name: &str, kind: &str) -> io::Result<(PathBuf, Option<File>)> {
    let pid = std::process::id();
    for i in 0..1000 {
        let suffix = if i == 0 { String::new() } else { format!("-{i}") };
        let dir = parent.join(format!(".{name}.{kind}-{pid}{suffix}"));
        match fs::create_dir(&dir) {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            Err(e) => return Err(e),
        }
        let lock = File::open(&dir).and_then(|f| f.lock().map(|()| f)).ok();
        // Between its creation and the lock another run may have taken it for abandoned.
        if dir.exists() {
            return Ok((dir, lock));
        }
    }
    Err(io::Error::new(io::ErrorKind::AlreadyExists, format!("remove the old folders .{name}.{kind}-* beside it")))
}

/// Removes what killed runs have left of the folder `name` in `parent`: what has its temporary names and nobody has
/// locked. An earlier result that one of them had moved aside is put back if nothing has taken its place.
fn clean_up(parent: &Path, name: &str, target: &Path) {
    // The folder may be missing or unreadable; whoever writes there will say so.
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let file_name = entry.file_name();
        let Some(kind) = file_name.to_str().and_then(|f| temporary_kind(f, name)) else { continue };
        if !entry.file_type().is_ok_and(|t| t.is_dir()) {
            continue;
        }
        let path = entry.path();
        if let Ok(lock) = File::open(&path)
            && lock.try_lock().is_ok()
        {
            if kind == OLD && !target.exists() {
                let _ = fs::rename(path.join(PREVIOUS), target);
            }
            if kind == PARTIAL || !path.join(PREVIOUS).exists() || target.exists() {
                let _ = fs::remove_dir_all(&path);
            }
        }
    }
}

/// Removes what killed runs have left of any folder in `parent`, as [`OutputDir::create`] does for the folder that it
/// starts. What somebody is at work on stays.
pub fn remove_abandoned(parent: &Path) {
    let target_of = |file: &str| {
        [PARTIAL, OLD].into_iter().find_map(|kind| {
            let (name, _) = file.strip_prefix('.')?.rsplit_once(&format!(".{kind}-"))?;
            temporary_kind(file, name).map(|_| name.to_owned())
        })
    };
    let entries = fs::read_dir(parent).into_iter().flatten().flatten();
    let targets: BTreeSet<String> = entries.filter_map(|e| target_of(e.file_name().to_str()?)).collect();
    for name in targets {
        clean_up(parent, &name, &parent.join(&name));
    }
}

/// Returns which kind of temporary folder of the folder `name` has this name: `.NAME.KIND-PID` or `.NAME.KIND-PID-N`.
fn temporary_kind(file: &str, name: &str) -> Option<&'static str> {
    let rest = file.strip_prefix('.')?.strip_prefix(name)?.strip_prefix('.')?;
    [PARTIAL, OLD].into_iter().find(|kind| {
        let numbers = rest.strip_prefix(kind).and_then(|r| r.strip_prefix('-'));
        let number = |n: &str| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit());
        numbers.is_some_and(|n| n.split('-').count() <= 2 && n.split('-').all(number))
    })
}
