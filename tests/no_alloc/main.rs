//! No allocation on the cycle path and in the filter, under an allocator that ends the program where there is one.

mod daemon;
mod estimate;

use assert_no_alloc::AllocDisabler;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;
