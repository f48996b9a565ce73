mod cost_volume;
mod filter;
mod judge;
mod lit_part;
mod neural;
mod outline;
mod refine;
