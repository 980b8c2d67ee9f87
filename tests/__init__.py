"""Tests, in folders named as the package's; helpers that several share are in tests/helpers."""

import pytest

pytest.register_assert_rewrite("tests.helpers")
