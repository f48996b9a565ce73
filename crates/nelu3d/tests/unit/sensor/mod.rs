mod blur;
mod compression;
mod crosstalk;
mod dark_level;
mod intensities;
pub(crate) mod measurements;
mod noise;
mod other_pattern;
mod scene_faults;
