//! Plants and closed loops with backlash: where the truth for every test of glapp comes from.
