mod frequency;
mod hash;
