mod compression;
mod crosstalk;
mod dark_level;
pub(crate) mod measurements;
mod noise;
mod scene_faults;
