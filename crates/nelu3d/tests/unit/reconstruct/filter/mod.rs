mod components;
mod continuation;
mod facing_away;
mod fading;
mod partly_covered;
mod pieces;
