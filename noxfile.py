"""The tests on every Python that the package supports: make test-all."""

import nox

nox.options.default_venv_backend = "uv|virtualenv"
nox.options.error_on_missing_interpreters = False
nox.options.reuse_existing_virtualenvs = True
PYTHONS = ("3.11", "3.12", "3.13")


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """Install with the pinned versions, then test; arguments go to pytest."""
    session.install("--constraint", "constraints.txt", "--editable", ".[dev,docs,cluster,export,sumo]")
    session.env["NUMBA_CACHE_DIR"] = str(session.cache_dir / f"kernels-{session.python}")
    session.run("python", "-m", "pytest", "--numprocesses", "2", "--dist", "loadfile", *session.posargs)
