//! Nothing: this package only chooses features; its manifest says why.
