"""Speed of torchbp (https://github.com/Ttl/torchbp), a public backprojector for CUDA, in the sums of `lab results gpu`.

    python3 lab/peers/torchbp_speed.py PIXELS SWEEPS SAMPLES

Coherent backprojection of SWEEPS range-compressed sweeps of SAMPLES values onto a square of PIXELS x PIXELS, linear between
samples: a square root, two lookups and a rotation for each pixel and sweep, as our `coherent`, without weights, beam
and motion during the sweep. Prints G updates (one pixel, one sweep) per second, the best of ten.
"""

import sys
import time

import torch
import torchbp

pixels, sweeps, samples = (int(argument) for argument in sys.argv[1:4])
data = torch.randn((sweeps, samples), dtype=torch.complex64, device="cuda")
pos = torch.rand((sweeps, 3), device="cuda")
grid = {"x": (-1.5, 1.5), "y": (-1.5, 1.5), "nx": pixels, "ny": pixels}
best = float("inf")
for _ in range(11):
    torch.cuda.synchronize()
    begin = time.perf_counter()
    torchbp.ops.backprojection_cart_2d(data, grid, 60.5e9, 3.0 / samples, pos)
    torch.cuda.synchronize()
    best = min(best, time.perf_counter() - begin)
print(pixels * pixels * sweeps / best * 1e-9)
