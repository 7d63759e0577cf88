"""Identification on a Dask cluster, for libraries that are too large for one machine.

    pip install "tactopose_drake[cluster]"
    python examples/identify_on_a_cluster.py

Starts a cluster of two workers on this machine, and identifies which of the package's objects is touched, both on the
cluster and in this process; the results are equal bit by bit. For a real cluster, only the line with `LocalCluster`
differs; its machines must have the same type of processor for the last bits to agree, and the same paths to the meshes.
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from dask.distributed import Client, LocalCluster

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path


def touch(library: tp.ObjectLibrary, name: str, seed: int) -> tp.Contacts:
    """Five contacts at random places on an object of the library."""
    generator = np.random.default_rng(seed)
    known = next(known for known in library.objects if known.name == name)
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]
    return touch_surface(known.load(), X_PO, 5, generator)


def facts(found: tp.Identification) -> list[tuple[str, float, float, bytes]]:
    """Names, likelihoods, evidence and best poses of an identification."""
    return [
        (
            identity.name,
            identity.likelihood,
            identity.log_evidence,
            identity.estimate.best.X_PO.GetAsMatrix34().tobytes(),
        )
        for identity in found
        if identity.estimate is not None
    ]


def main() -> None:
    """Identifies the object on the cluster and in this process."""
    parser = argparse.ArgumentParser(description="Identifies a touched object on a Dask cluster.")
    parser.add_argument("--library", type=Path, default=model_path("objects"), help="folder of meshes, or a manifest")
    parser.add_argument("--touched", default="mug", help="the object that is touched")
    parser.add_argument("--seed", type=int, default=0, help="of the touch")
    arguments = parser.parse_args()
    with (
        TemporaryDirectory() as scratch,
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            worker_dashboard_address=None,
            local_directory=scratch,
        ) as cluster,
        Client(cluster) as client,
    ):
        executor = client.get_executor()
        library = tp.ObjectLibrary.open(arguments.library, executor=executor)
        contacts = touch(library, arguments.touched, arguments.seed)
        by_cluster = tp.identify(library, contacts, executor=executor)
    here = tp.identify(library, contacts)
    for identity in by_cluster[:3]:
        print(f"{identity.rank}. {identity.name}: {identity.likelihood:.1%}")
    print("This process says the same." if facts(by_cluster) == facts(here) else "This process says something else!")


if __name__ == "__main__":
    main()
