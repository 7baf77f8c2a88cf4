"""Options that say where many runs are computed, and the workers that they name."""

import argparse
import os
from typing import TYPE_CHECKING

from uvms_drake.common.errors import require

if TYPE_CHECKING:
    from uvms_drake.campaign.pool import Pool


def take_workers(command: argparse.ArgumentParser) -> None:
    """Adds the options --workers and --scheduler."""
    where = command.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="W",
                       help="processes of this machine (default: one for each core)")
    where.add_argument("--scheduler", metavar="ADDRESS",
                       help="of a running Dask cluster, whose workers have this package installed")


def check_workers(args: argparse.Namespace) -> None:
    """Raises `InvalidParameter` for a number of workers that cannot be."""
    require(args.workers is None or args.workers >= 1, "--workers", args.workers, "at least 1")


def pool_of(args: argparse.Namespace) -> "Pool":
    """Returns the workers of the options."""
    from uvms_drake.campaign.pool import cluster_pool, local_pool

    if args.scheduler is not None:
        return cluster_pool(args.scheduler)
    return local_pool(args.workers or _cores())


def _cores() -> int:
    """Returns the number of cores available to this process; on macOS that of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
