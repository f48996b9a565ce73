mod bounds;
mod distances;
mod importance;
mod lookup_start;
#[cfg(feature = "gpu")]
mod on_gpu;
mod start;
mod view;
