//! The fuzz targets in every test run: their seeds and regressions, whole and with a fixed sequence of changes. The
//! search that follows coverage is libFuzzer's; see `fuzz/README.md`.

#[path = "../../../fuzz/targets.rs"]
mod targets;
#[path = "../../nelu3d-scan/tests/unit/foreign_bytes/watched.rs"]
mod watched;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use targets::{TARGETS, Target};

/// Changed inputs of each target, times `NELU3D_MORE_CASES` for a long search.
const INPUTS: usize = 2500;

/// Longest time for the changed inputs of a target: slow machines try fewer of them.
const MAX_TIME: Duration = Duration::from_secs(4);

fn folder(kind: &str, target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz").join(kind).join(target)
}

/// The files of a folder with their names, in order; none if it is not there.
fn files(dir: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<PathBuf> = fs::read_dir(dir).into_iter().flatten().map(|e| e.unwrap().path()).collect();
    all.sort();
    let name = |p: &Path| p.file_name().unwrap().to_string_lossy().into_owned();
    all.iter().map(|p| (name(p), fs::read(p).unwrap())).collect()
}

/// Runs a target. Where it panics, the input is kept for whoever looks into it, for a checkout of CI is thrown away.
fn run(name: &str, target: Target, bytes: &[u8]) -> bool {
    let outcome = std::panic::catch_unwind(|| watched::watched(|| target(bytes)));
    outcome.unwrap_or_else(|_| {
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz-{name}"));
        fs::write(&file, bytes).unwrap();
        panic!("{name}: {} broke it; its bytes: {:02x?}", file.display(), &bytes[..bytes.len().min(2000)]);
    })
}

/// Changes a file in up to four places: bytes, numbers of two and four bytes, cuts, copies of its own parts.
fn change(bytes: &mut Vec<u8>, random: &mut Random) {
    const ODD: [u32; 8] = [0, 1, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff];
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            return;
        }
        // Half of the places lie where headers are.
        let n = if random.below(2) == 0 { bytes.len().min(256) } else { bytes.len() };
        let at = random.below(n);
        let number = if random.below(2) == 0 { ODD[random.below(ODD.len())] } else { random.below(1 << 20) as u32 };
        let written = match random.below(8) {
            0 => vec![random.below(256) as u8],
            1 => vec![bytes[at] ^ 1 << random.below(8)],
            2 => number.to_le_bytes().to_vec(),
            3 => number.to_be_bytes().to_vec(),
            4 => (number as u16).to_le_bytes().to_vec(),
            5 => {
                bytes.truncate(at);
                continue;
            }
            6 => {
                bytes.drain(at..(at + 1 + random.below(8)).min(bytes.len()));
                continue;
            }
            _ => {
                let from = random.below(bytes.len());
                let part = bytes[from..(from + 1 + random.below(16)).min(bytes.len())].to_vec();
                bytes.splice(at..at, part);
                continue;
            }
        };
        bytes[at..].iter_mut().zip(written).for_each(|(b, v)| *b = v);
    }
}

/// A linear congruential generator (Knuth, MMIX): the same inputs every time.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }
}

#[test]
fn targets_take_what_they_are_made_for_and_survive_the_rest() {
    let more: usize = std::env::var("NELU3D_MORE_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(1);
    for (k, (name, target)) in TARGETS.into_iter().enumerate() {
        let seeds = files(&folder("seeds", name));
        assert!(!seeds.is_empty(), "{name} has no seeds");
        for (file, bytes) in &seeds {
            assert!(run(name, target, bytes), "{name} refuses its seed {file}");
        }
        let known = files(&folder("regressions", name));
        for (_, bytes) in &known {
            run(name, target, bytes);
        }
        let all: Vec<&Vec<u8>> = seeds.iter().chain(&known).map(|(_, bytes)| bytes).collect();
        let (mut random, start, mut taken) = (Random(k as u64), Instant::now(), 0);
        for i in 0..INPUTS * more {
            if start.elapsed() > MAX_TIME * more as u32 {
                eprintln!("{name}: {i} of {} inputs, for this machine is slow", INPUTS * more);
                break;
            }
            let mut bytes = all[i % all.len()].clone();
            change(&mut bytes, &mut random);
            taken += usize::from(run(name, target, &bytes));
        }
        // Changes that break everything at once would reach nothing behind the first check.
        assert!(taken > 0, "{name} takes no changed input");
    }
}
