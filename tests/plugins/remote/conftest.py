"""Shared fixtures of the remote store: an S3 server behind a proxy that fails on demand."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.plugins.remote.s3 import CREDENTIALS, Proxy, serving


@pytest.fixture(scope="session")
def _server() -> Iterator[Proxy]:
    with serving() as proxy:
        yield proxy


@pytest.fixture
def s3(_server: Proxy, monkeypatch: pytest.MonkeyPatch) -> Proxy:
    """The proxy without a fault, and an environment by which clients find it."""
    for name, value in {**CREDENTIALS, "AWS_ENDPOINT_URL": _server.url}.items():
        monkeypatch.setenv(name, value)
    _server.fault, _server.seconds = None, 0.0
    _server.expect(together=0)
    return _server
