mod blur;
mod compression;
mod crosstalk;
mod dark_level;
mod intensities;
pub(crate) mod measurements;
mod noise;
mod scene_faults;
