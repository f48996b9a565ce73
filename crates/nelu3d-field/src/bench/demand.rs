//! What a piece of work asks of a machine: flops, bytes, accesses at random.

use super::machine::{self, Machine, Rate};

/// Accesses to one table at random.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Accesses {
    /// Bytes of the table, or of all that is used between two uses of a line.
    pub table_bytes: usize,
    /// Accesses.
    pub n: f64,
    /// Cache lines they need: several accesses by one point to one line need it once.
    pub lines: f64,
}

/// The demand of a piece of work on the machine.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Demand {
    /// Floating-point operations; a fused multiply-add is two.
    pub flops: f64,
    /// Bytes that come from or go to main memory in order.
    pub bytes: f64,
    /// Reading at random.
    pub reads: Vec<Accesses>,
    /// Reading and writing at random.
    pub updates: Vec<Accesses>,
    /// Exponentials in double precision.
    pub exponentials: f64,
}

impl Demand {
    /// Returns the least time of every part on a machine, s.
    fn parts(&self, machine: &Machine) -> [(&'static str, f64); 5] {
        // Every access takes a place in the processor's pipeline; every line must come from where it is.
        let random = |demand: &[Accesses], rates: &[Rate]| -> f64 {
            let near = 1.0 / rates[0].lines_per_sec;
            let secs = |a: &Accesses| {
                a.n * near + a.lines * (1.0 / machine::interpolate(rates, a.table_bytes) - near).max(0.0)
            };
            demand.iter().map(secs).sum()
        };
        [
            ("arithmetic", self.flops / machine.flops_per_sec),
            ("bandwidth", self.bytes / machine.bytes_per_sec),
            ("random reads", random(&self.reads, &machine.reads)),
            ("random updates", random(&self.updates, &machine.updates)),
            ("exponentials", self.exponentials / machine.exponentials_per_sec),
        ]
    }

    /// Returns the least time on a machine, s: its slowest part, as if everything else went on beside it; and which
    /// part that is.
    pub fn floor(&self, machine: &Machine) -> (&'static str, f64) {
        self.parts(machine).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("five parts")
    }
}

/// A kernel at a named size.
pub struct Case {
    /// What is run, and on what.
    pub name: String,
    /// Points (samples, parameters) of one run.
    pub points: usize,
    /// What one run asks of the machine.
    pub demand: Demand,
    /// One run, on the calling thread.
    pub run: Box<dyn FnMut()>,
}
