"""One signal asks, the second acts as ever; other threads are left alone."""

import os
import signal
import threading

import pytest

from pretrain.interrupt import stop_requests


@pytest.fixture
def interruptible():
    """As in a foreground process; a shell starts those in the background with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_first_signal_asks_and_the_second_interrupts():
    with stop_requests() as stop:
        assert not stop.is_set()
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.wait(1)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_handlers_come_back_even_after_an_error():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(ValueError, match="mine"), stop_requests():
        raise ValueError("mine")
    assert signal.getsignal(signal.SIGTERM) is before


def test_outside_the_main_thread_nothing_is_handled():
    found = []

    def work():
        with stop_requests() as stop:
            found.append((signal.getsignal(signal.SIGINT), stop.is_set()))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [(before, False)]
