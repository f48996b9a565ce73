mod components;
mod continuation;
mod facing_away;
mod partly_covered;
mod pieces;
