//! The header gives each block the memory that it needs, and its settings the members that they have.

use glapp_embedded::{COMPENSATION, DETECTOR, PID, double, single};

fn words(kind: &str) -> usize {
    let header = include_str!("../include/glapp_embedded.h");
    let (before, _) = header.split_once(&format!("]; }} glapp_{kind};")).unwrap_or_else(|| panic!("no glapp_{kind}"));
    before.rsplit('[').next().unwrap().parse().unwrap()
}

#[test]
fn the_memory_of_each_block_is_that_of_the_header() {
    let kinds = ["detector", "compensation", "pid"].into_iter().zip([DETECTOR, COMPENSATION, PID]);
    for ((kind, (of_single, of_double)), (needs_single, needs_double)) in
        kinds.zip(single::NEEDED.into_iter().zip(double::NEEDED))
    {
        assert_eq!(8 * words(&format!("{kind}_f32")), of_single, "{kind}");
        assert_eq!(8 * words(&format!("{kind}_f64")), of_double, "{kind}");
        assert!(needs_single <= of_single && needs_double <= of_double, "{kind}: {needs_single} and {needs_double}");
    }
}

/// Numbers, then whole numbers, without a hole, as a C compiler lays them out.
#[test]
fn settings_are_laid_out_as_in_c() {
    fn size<T>() -> usize {
        size_of::<T>()
    }
    let up = |bytes: usize, align: usize| bytes.div_ceil(align) * align;
    let all = [
        (size::<single::DetectorGiven>(), size::<double::DetectorGiven>(), 11, 2),
        (size::<single::Estimated>(), size::<double::Estimated>(), 4, 2),
        (size::<single::CompensationGiven>(), size::<double::CompensationGiven>(), 14, 3),
        (size::<single::PidGiven>(), size::<double::PidGiven>(), 10, 0),
    ];
    for (in_single, in_double, numbers, whole) in all {
        assert_eq!((in_single, in_double), (4 * (numbers + whole), up(8 * numbers + 4 * whole, 8)));
    }
}
