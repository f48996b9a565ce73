//! Exchanging two folders in one step, where the system can.

use std::io;
use std::path::Path;

/// Exchanges the names of two folders in one step: at no moment is either missing. `Ok(false)` where the system or the
/// disk cannot do that (Windows, some network disks).
///
/// # Errors
///
/// The file system refuses for another reason.
#[cfg(any(target_os = "linux", target_os = "android", target_vendor = "apple"))]
pub fn exchange(a: &Path, b: &Path) -> io::Result<bool> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    use rustix::io::Errno;
    match renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE) {
        Ok(()) => Ok(true),
        Err(e) if [Errno::INVAL, Errno::NOSYS, Errno::NOTSUP, Errno::OPNOTSUPP].contains(&e) => Ok(false),
        Err(e) => Err(e.into()),
    }
}

/// Exchanges the names of two folders in one step where the system can; this one cannot.
///
/// # Errors
///
/// None: it is always `Ok(false)`.
#[cfg(not(any(target_os = "linux", target_os = "android", target_vendor = "apple")))]
pub fn exchange(_: &Path, _: &Path) -> io::Result<bool> {
    Ok(false)
}
