//! Tables of the line-of-sight kernel: its values, and its integral over rectangles.

use crate::model::Kernel;
use std::sync::OnceLock;

/// The line-of-sight kernel `F(q)` ([`Kernel::projected`]) at evenly spaced `q`, read with linear interpolation. The
/// interpolation error is below 1e-6 of `F(0)`.
pub struct LineTable {
    values: Vec<f64>,
}

impl LineTable {
    const STEPS: usize = 4096;

    /// The table of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static LineTable {
        static TABLES: [OnceLock<LineTable>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| LineTable {
            values: (0..=LineTable::STEPS + 1).map(|i| kernel.projected(i as f64 / LineTable::STEPS as f64)).collect(),
        })
    }

    /// `F` at `q^2`; zero from `q = 1` on, and for NaN.
    pub fn at_square(&self, square: f64) -> f64 {
        if square.is_nan() || square >= 1.0 {
            return 0.0;
        }
        let position = square.max(0.0).sqrt() * LineTable::STEPS as f64;
        let index = position as usize;
        let fraction = position - index as f64;
        self.values[index] * (1.0 - fraction) + self.values[index + 1] * fraction
    }
}

/// The integral of the line-of-sight kernel over rectangles, from the cumulative integral
/// `C(x, y) = integral of F over [0, x] x [0, y]` (lengths in units of `h`).
///
/// Integrals over the cells of any grid telescope: they add up to exactly 1 for a grid that holds the whole kernel,
/// however small the kernel is.
pub struct CumulativeTable {
    /// `C`, `dC/dx`, `dC/dy`, `d2C/dxdy` at the nodes of a square grid over [0, 1]^2, row by row, the last three in
    /// units of the grid's step.
    nodes: Vec<[f64; 4]>,
}

impl CumulativeTable {
    const STEPS: usize = 96;

    /// The table of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static CumulativeTable {
        static TABLES: [OnceLock<CumulativeTable>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| CumulativeTable::compute(kernel))
    }

    fn compute(kernel: Kernel) -> CumulativeTable {
        // Gauss-Legendre with four nodes on [0, 1].
        const GAUSS: [(f64, f64); 4] = [
            (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
            (0.330_009_478_207_571_9, 0.326_072_577_431_273_07),
            (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
            (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
        ];
        let n = CumulativeTable::STEPS;
        let step = 1.0 / n as f64;
        let f = |x: f64, y: f64| kernel.projected(x.hypot(y));
        let mut nodes = vec![[0.0; 4]; (n + 1) * (n + 1)];
        for j in 0..=n {
            for i in 0..=n {
                let (x, y) = (i as f64 * step, j as f64 * step);
                nodes[j * (n + 1) + i][3] = f(x, y) * step * step;
                if i < n {
                    // Integral of F over x along this row: dC/dy at the next node.
                    let along: f64 = GAUSS.iter().map(|&(g, w)| w * f(x + g * step, y)).sum();
                    nodes[j * (n + 1) + i + 1][2] = nodes[j * (n + 1) + i][2] + along * step * step;
                }
            }
        }
        for j in 0..=n {
            for i in 0..=n {
                // F is symmetric in x and y.
                nodes[j * (n + 1) + i][1] = nodes[i * (n + 1) + j][2];
                if i < n && j < n {
                    let cell: f64 = GAUSS
                        .iter()
                        .flat_map(|&(gy, wy)| GAUSS.iter().map(move |&(gx, wx)| (gx, gy, wx * wy)))
                        .map(|(gx, gy, w)| w * f((i as f64 + gx) * step, (j as f64 + gy) * step))
                        .sum();
                    let before = nodes[(j + 1) * (n + 1) + i][0] + nodes[j * (n + 1) + i + 1][0];
                    nodes[(j + 1) * (n + 1) + i + 1][0] = before - nodes[j * (n + 1) + i][0] + cell * step * step;
                }
            }
        }
        // The quadrant's integral is exactly 1/4.
        let scale = 0.25 / nodes[(n + 1) * (n + 1) - 1][0];
        nodes.iter_mut().flatten().for_each(|value| *value *= scale);
        CumulativeTable { nodes }
    }

    /// `C(x, y)`, odd in both arguments; arguments beyond the support count as at its edge.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let n = CumulativeTable::STEPS;
        let locate = |value: f64| {
            let position = value.abs().min(1.0) * n as f64;
            let index = (position as usize).min(n - 1);
            (index, position - index as f64)
        };
        let ((i, u), (j, v)) = (locate(x), locate(y));
        // Bicubic Hermite interpolation with exact derivatives.
        let hermite = |t: f64| {
            let (t2, t3) = (t * t, t * t * t);
            [2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, 3.0 * t2 - 2.0 * t3, t3 - t2]
        };
        let (a, b) = (hermite(u), hermite(v));
        let corner = |di: usize, dj: usize| {
            let [c, cx, cy, cxy] = self.nodes[(j + dj) * (n + 1) + i + di];
            let (value_x, slope_x, value_y, slope_y) = (a[2 * di], a[2 * di + 1], b[2 * dj], b[2 * dj + 1]);
            value_y * (value_x * c + slope_x * cx) + slope_y * (value_x * cy + slope_x * cxy)
        };
        let value = corner(0, 0) + corner(1, 0) + corner(0, 1) + corner(1, 1);
        if (x < 0.0) == (y < 0.0) { value } else { -value }
    }

    /// `dC/dy`: the integral of `F` along the line at `y` from 0 to `x`. Odd in `x` and even in `y`; 0 beyond the support in `y`,
    /// and beyond it in `x` as at its edge.
    pub fn along(&self, x: f64, y: f64) -> f64 {
        let n = CumulativeTable::STEPS;
        if y.is_nan() || y.abs() >= 1.0 {
            return 0.0;
        }
        let locate = |value: f64| {
            let position = value.abs().min(1.0) * n as f64;
            let index = (position as usize).min(n - 1);
            (index, position - index as f64)
        };
        let ((i, u), (j, v)) = (locate(x), locate(y));
        // The derivative at the nodes is exact; between them it is read as what its own slopes and those of `C` ask for.
        let (u2, u3) = (u * u, u * u * u);
        let across = [2.0 * u3 - 3.0 * u2 + 1.0, u3 - 2.0 * u2 + u, 3.0 * u2 - 2.0 * u3, u3 - u2];
        let value = |row: usize, derivative: usize| {
            let (a, b) = (&self.nodes[row * (n + 1) + i], &self.nodes[row * (n + 1) + i + 1]);
            across[0] * a[derivative]
                + across[1] * a[derivative + 1]
                + across[2] * b[derivative]
                + across[3] * b[derivative + 1]
        };
        let rise = value(j + 1, 0) - value(j, 0);
        let (start, end) = (value(j, 2), value(j + 1, 2));
        // Derivative of the cubic with these ends and slopes.
        let slope = 6.0 * (v - v * v) * rise + (3.0 * v * v - 4.0 * v + 1.0) * start + (3.0 * v * v - 2.0 * v) * end;
        let slope = slope * n as f64;
        if x < 0.0 { -slope } else { slope }
    }

    /// Integral of `F` over the rectangle from `(x0, y0)` to `(x1, y1)`, relative to the kernel's centre in units of `h`.
    pub fn rectangle(&self, x0: f64, y0: f64, x1: f64, y1: f64) -> f64 {
        self.at(x1, y1) - self.at(x0, y1) - self.at(x1, y0) + self.at(x0, y0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_table_follows_the_kernel() {
        for kernel in Kernel::ALL {
            let table = LineTable::of(kernel);
            for i in 0..3000 {
                let q = f64::from(i) * 0.000_37;
                let error = (table.at_square(q * q) - kernel.projected(q)).abs();
                assert!(error < 1e-6 * kernel.projected(0.0), "{kernel:?} at {q}: {error}");
            }
            assert_eq!(table.at_square(f64::NAN), 0.0);
        }
    }

    #[test]
    fn integrals_along_lines_agree_with_quadrature() {
        for kernel in Kernel::ALL {
            let table = CumulativeTable::of(kernel);
            for i in 0..40 {
                for j in 0..40 {
                    let (x, y) = (f64::from(i) * 0.027 - 0.5, f64::from(j) * 0.0263);
                    let step = x / 500.0;
                    let at = |k: i32| kernel.projected(((f64::from(k) + 0.5) * step).hypot(y));
                    let expected = (0..500).map(at).sum::<f64>() * step;
                    let found = table.along(x, y);
                    assert!((found - expected).abs() < 3e-6, "{kernel:?} ({x}, {y}): {found} against {expected}");
                    assert_eq!(table.along(x, -y), found);
                }
            }
        }
    }

    #[test]
    fn rectangles_agree_with_quadrature_and_add_up() {
        for kernel in Kernel::ALL {
            let table = CumulativeTable::of(kernel);
            assert!((table.rectangle(-2.0, -1.0, 1.5, 7.0) - 1.0).abs() < 1e-15);
            for (x0, y0, size) in [(-0.13, 0.21, 0.1), (0.4, -0.9, 0.37), (-0.03, -0.02, 0.05), (0.6, 0.6, 0.3)] {
                let n = 400;
                let mut sum = 0.0;
                for j in 0..n {
                    for i in 0..n {
                        let at = |k: i32, from: f64| from + (f64::from(k) + 0.5) * size / f64::from(n);
                        sum += kernel.projected(at(i, x0).hypot(at(j, y0)));
                    }
                }
                let expected = sum * (size / f64::from(n)).powi(2);
                let found = table.rectangle(x0, y0, x0 + size, y0 + size);
                assert!((found - expected).abs() < 2e-7, "{kernel:?} ({x0}, {y0}): {found} against {expected}");
            }
        }
    }
}
