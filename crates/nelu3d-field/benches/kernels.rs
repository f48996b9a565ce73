//! Every kernel and training step by name, one thread: `cargo bench -p nelu3d-field [-- FILTER]`.
//!
//! The same cases as `nelu3d bench`, which also says how far each is from what the machine allows. This one is for
//! comparing two states of the code: divan shows the spread and not only the best.

use divan::counter::ItemsCount;
use divan::{AllocProfiler, Bencher};
use nelu3d_field::bench::{SurfaceBench, kernels, steps};
use std::cell::RefCell;

/// Shows that a step allocates nothing.
#[global_allocator]
static ALLOCATOR: AllocProfiler = AllocProfiler::system();

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is made once");
    divan::main();
}

fn kernel_names() -> Vec<String> {
    kernels().into_iter().map(|case| case.name).collect()
}

#[divan::bench(args = kernel_names())]
fn kernel(bencher: Bencher, name: &str) {
    let case = kernels().into_iter().find(|case| case.name == name).expect("a name from the list");
    let run = RefCell::new(case.run);
    bencher.counter(ItemsCount::new(case.points)).bench_local(|| (run.borrow_mut())());
}

fn step_names() -> Vec<&'static str> {
    steps().into_iter().map(|shape| shape.name).collect()
}

#[divan::bench(args = step_names())]
fn step(bencher: Bencher, name: &str) {
    let shape = steps().into_iter().find(|shape| shape.name == name).expect("a name from the list");
    let mut bench = SurfaceBench::new(&shape);
    // The first steps make the optimizer's memory.
    for _ in 0..4 {
        bench.step();
    }
    bencher.counter(ItemsCount::new(shape.n_points())).bench_local(|| bench.step());
}
