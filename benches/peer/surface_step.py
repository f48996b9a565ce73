"""One training step of a neural surface, written the straightforward way in PyTorch.

The peer of `nelu3d bench`: the same encoding (spatial hash of Instant NGP), network, compositing, losses and optimizer as
`nelu3d_field::surface`, with `index_select` for the hash gather, `nn.Linear`, autograd (twice for the eikonal loss) and
`torch.optim.Adam`. Prints one line of JSON per step size.

    pip install torch numpy
    python benches/peer/surface_step.py [--threads 2] [--steps 10] [--device cpu|cuda] [--rays N] [full narrow narrow-small]

The CPU time is that of the whole process (`time.process_time`), so a second thread costs what it uses.
"""

import argparse
import json
import math
import time

import torch

# Shapes of the steps; `nelu3d bench` has the same numbers (crates/nelu3d-field/src/bench/steps.rs).
STEPS = {
    "full": dict(rays=1024, samples=32, log2=19, levels=16, finest=2048, band=1.0, eikonal=8, hidden=2),
    "narrow": dict(rays=1024, samples=16, log2=19, levels=16, finest=2048, band=0.02, eikonal=2, hidden=2),
    "narrow-small": dict(rays=1024, samples=16, log2=17, levels=12, finest=512, band=0.02, eikonal=2, hidden=1),
}
FEATURES, BASE, WIDTH, PATTERNS = 2, 16, 64, 3
PRIMES = (1, 2654435761, 805459861)


class HashGrid(torch.nn.Module):
    """Multiresolution hash encoding: dense levels where they fit, hashed ones above (Mueller et al. 2022, Sec. 3)."""

    def __init__(self, levels, log2, finest):
        super().__init__()
        growth = (finest / BASE) ** (1 / (levels - 1))
        self.resolutions = [round(BASE * growth**level) for level in range(levels)]
        self.sizes = [min((n + 1) ** 3, 1 << log2) for n in self.resolutions]
        self.dense = [(n + 1) ** 3 <= 1 << log2 for n in self.resolutions]
        self.offsets = [sum(self.sizes[:level]) for level in range(levels)]
        self.table = torch.nn.Parameter(torch.empty(sum(self.sizes), FEATURES).uniform_(-1e-4, 1e-4))
        corners = [[corner >> axis & 1 for axis in range(3)] for corner in range(8)]
        self.register_buffer("corners", torch.tensor(corners))

    def forward(self, x):
        features = []
        for n, size, dense, offset in zip(self.resolutions, self.sizes, self.dense, self.offsets):
            position = x * n
            low = position.detach().floor().clamp(0, n - 1)
            fraction = (position - low)[:, None, :]
            vertex = low.long()[:, None, :] + self.corners
            if dense:
                index = vertex[..., 0] + (n + 1) * (vertex[..., 1] + (n + 1) * vertex[..., 2])
            else:
                index = vertex[..., 0] ^ (vertex[..., 1] * PRIMES[1]) ^ (vertex[..., 2] * PRIMES[2])
                index = index % size
            weight = torch.where(self.corners.bool(), fraction, 1 - fraction).prod(dim=-1)
            values = self.table.index_select(0, index.reshape(-1) + offset).view(-1, 8, FEATURES)
            features.append((weight[..., None] * values).sum(dim=1))
        return torch.cat(features, dim=-1)


class Surface(torch.nn.Module):
    """Signed distance field: hash grid and position, hidden layers of ReLU; and the sharpness inv_s."""

    def __init__(self, levels, log2, finest, hidden):
        super().__init__()
        self.grid = HashGrid(levels, log2, finest)
        layers, width = [], levels * FEATURES + 3
        for _ in range(hidden):
            layers += [torch.nn.Linear(width, WIDTH), torch.nn.ReLU()]
            width = WIDTH
        self.network = torch.nn.Sequential(*layers, torch.nn.Linear(width, 1))
        self.variance = torch.nn.Parameter(torch.tensor(0.3))

    def sdf(self, x):
        return self.network(torch.cat([self.grid(x), x], dim=-1)).squeeze(-1)


def batch(rays, samples, band, generator):
    """Rays along z through a bumpy surface; samples in order within the band; codewords and measurements."""
    origin = torch.rand(rays, 2, generator=generator)
    surface = 0.5 + 0.1 * torch.sin(6 * origin[:, 0]) * torch.cos(5 * origin[:, 1])
    low, high = (surface - band / 2).clamp(0, 1), (surface + band / 2).clamp(0, 1)
    at = (torch.arange(samples) + torch.rand(rays, samples, generator=generator)) / samples
    z = low[:, None] + (high - low)[:, None] * at
    x = torch.cat([origin[:, None, :].expand(-1, samples, -1), z[..., None]], dim=-1)
    phase = torch.arange(PATTERNS) * 2 * math.pi / PATTERNS
    code = lambda z: 0.5 + 0.5 * torch.cos(40 * z[..., None] + phase)
    return x, code(z), code(surface)


def step(model, optimizer, x, colors, measured, eikonal_every):
    rays, samples, _ = x.shape
    flat = x.reshape(-1, 3)
    inside = torch.arange(flat.shape[0]) % eikonal_every == 0
    on, off = flat[inside].requires_grad_(True), flat[~inside]
    sdf_on = model.sdf(on)
    (gradient,) = torch.autograd.grad(sdf_on.sum(), on, create_graph=True)
    sdf = torch.empty(flat.shape[0]).index_put((inside,), sdf_on).index_put((~inside,), model.sdf(off))

    inv_s = torch.exp(10 * model.variance)
    log_phi = torch.nn.functional.logsigmoid(inv_s * sdf.view(rays, samples))
    delta = (log_phi[:, 1:] - log_phi[:, :-1]).clamp(max=0)
    alpha = -torch.expm1(delta)
    passed = torch.cumsum(torch.cat([torch.zeros(rays, 1), delta], dim=1)[:, :-1], dim=1)
    weights = torch.exp(passed) * alpha
    image = (weights[..., None] * colors[:, :-1]).sum(dim=1)
    opacity = weights.sum(dim=1).clamp(1e-3, 1 - 1e-3)

    residual = image - measured
    loss = (residual.abs() + 10 * residual**2).mean()
    loss = loss - 0.1 * opacity.log().mean()
    loss = loss + 0.1 * ((gradient.norm(dim=-1) - 1) ** 2).mean()
    loss = loss + 0.01 * torch.exp(-sdf.abs()).mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    return loss.item()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=list(STEPS), help="full, narrow, narrow-small")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rays", type=int, help="instead of the shape's own")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    for name in arguments.names:
        shape = dict(STEPS[name], **({"rays": arguments.rays} if arguments.rays else {}))
        torch.set_default_device("cpu")
        torch.manual_seed(0)
        generator = torch.Generator().manual_seed(1)
        model = Surface(shape["levels"], shape["log2"], shape["finest"], shape["hidden"])
        model.to(arguments.device)
        optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, betas=(0.9, 0.99), eps=1e-15)
        batches = [batch(shape["rays"], shape["samples"], shape["band"], generator) for _ in range(4)]
        batches = [[part.to(arguments.device) for part in parts] for parts in batches]
        torch.set_default_device(arguments.device)
        for i in range(2):
            step(model, optimizer, *batches[i % 4], shape["eikonal"])
        cpu, wall = time.process_time(), time.perf_counter()
        for i in range(arguments.steps):
            loss = step(model, optimizer, *batches[i % 4], shape["eikonal"])
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        points = shape["rays"] * shape["samples"] * arguments.steps
        report = dict(step=name, device=arguments.device, seconds_per_step=wall / arguments.steps, threads=arguments.threads, torch=torch.__version__, loss=loss)
        report.update(points_per_cpu_second=round(points / cpu), points_per_second=round(points / wall))
        print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
