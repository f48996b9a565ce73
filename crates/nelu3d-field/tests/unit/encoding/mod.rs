mod frequency;
mod hash_grid;
