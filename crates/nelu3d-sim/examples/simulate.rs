//! Writes the rig of a preset, or of a spec file, and says how long that took: `simulate demo /tmp/demo`.

use std::path::Path;
use std::time::Instant;

use nelu3d_sim::{Spec, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [spec, out] = args.as_slice() else { return Err("usage: simulate PRESET|SPEC.toml OUT".into()) };
    let spec = Spec::preset(spec).map_or_else(|| Spec::read(Path::new(spec)), Ok)?;
    let start = Instant::now();
    simulate(&spec, Path::new(out), &|stage, done, total| eprintln!("{stage} {done}/{total}"))?;
    println!("{:.2} s", start.elapsed().as_secs_f64());
    Ok(())
}
