mod components;
mod continuation;
mod partly_covered;
