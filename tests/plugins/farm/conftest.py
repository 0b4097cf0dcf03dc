"""The remote store of farms without a disk in common."""

from tests.production.farm.conftest import store as store
