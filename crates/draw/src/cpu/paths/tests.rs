//! Chords, coverage and order.
