import socket
import threading

import numpy as np
import pytest

from tensionlab.errors import HardwareError, LinkError
from tensionlab.validation.sensors import DriftNoise, ForceParser, open_sensor

ATI = """"Start Time: 11/21/2026 9:00:00 AM"
"RDT Sample Rate: 1000"
"Force Units: N"
"Counts per Unit Force: 1000000"
"Torque Units: Nmm"
"Counts per Unit Torque: 1000000"
"Status (hex)","RDT Sequence","F/T Sequence","Fx","Fy","Fz","Tx","Ty","Tz","Time"
"0","1","4711","1500000","-250000","0","1","2","3","9:00:00 AM"
"0","2","4712","1500000","-250000","125000","1","2","3","9:00:00 AM"
"""


def test_a_table_of_ati_is_scaled_by_its_counts():
    assert ForceParser("nano17").feed(ATI).tolist() == [[1.5, -0.25, 0.0], [1.5, -0.25, 0.125]]
    pounds = ForceParser("nano17").feed(ATI.replace('Units: N"', 'Units: lbf"'))
    assert pounds[0, 0] == pytest.approx(1.5 * 4.44822)


@pytest.mark.parametrize(
    "text",
    [
        "Time,Fx (N),Fy (N),Fz (N)\n0,1,2,3\n0.001,4,5,6\n",
        "1 2 3\n4 5 6\n",
        "1;2;3;0;0;0\n4,5,6,0,0,0\r\n",
        "# hello\n1,2,3\n\n4,5,6\n",
    ],
)
def test_other_tables_and_bare_numbers(text):
    parser = ForceParser("there")
    pieces = [parser.feed(piece) for piece in text]  # letter by letter
    assert np.concatenate(pieces).tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("1,2\n", "line 1: 2 numbers"),
        ("Fx,Fy,Fz\n1,2,x\n", "line 2: '1,2,x' has no three forces"),
        ("Fx,Fy,Fz\n1,2,nan\n", "no three forces"),
        ("Fx,Fy,Fz\n1,2\n", "no three forces"),
        ('"Force Units: furlong"\n', "forces in 'furlong'"),
        ('"Counts per Unit Force: 0"\n', "counts per unit"),
    ],
)
def test_what_is_no_force_is_named_by_its_line(text, complaint):
    with pytest.raises(HardwareError, match=f"there, {complaint}" if complaint.startswith("line") else complaint):
        ForceParser("there").feed(text)


def test_a_file_is_followed_from_where_it_is(tmp_path):
    file = tmp_path / "live.csv"
    file.write_text("Fx,Fy,Fz\n9,9,9\n", encoding="utf-8")
    sensor = open_sensor(str(file))
    with file.open("a", encoding="utf-8") as more:
        more.write("1,2,3\n4,5")
        more.flush()
        assert sensor.take().tolist() == [[1, 2, 3]]
        more.write(",6\n")
        more.flush()
        assert sensor.take().tolist() == [[4, 5, 6]]
    assert sensor.take().shape == (0, 3)
    assert not sensor.simulated
    sensor.close()


def test_files_without_forces_are_refused(tmp_path):
    with pytest.raises(HardwareError, match=r"nowhere\.csv: cannot be read"):
        open_sensor(str(tmp_path / "nowhere.csv"))
    other = tmp_path / "other.csv"
    other.write_bytes(b"Fx,Fy,Fz\n\xff\xfe\x00,1,2\n")
    with pytest.raises(HardwareError, match=r"line 2: .* has no three forces"):
        open_sensor(other)


@pytest.fixture
def server():
    """A port, and what to say to the one who connects."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(5.0)

        def serve(content):
            client, _ = listener.accept()
            with client:
                client.sendall(content)
                ready.wait(5.0)

        ready = threading.Event()
        threads = []

        def start(content):
            threads.append(threading.Thread(target=serve, args=(content,)))
            threads[0].start()
            return f"tcp://127.0.0.1:{listener.getsockname()[1]}", ready.set

        yield start
        ready.set()
        for thread in threads:
            thread.join()


def test_a_sensor_at_a_port_and_its_end(server):
    url, leave = server(b"# simulated\n1 2 3\n4 5 6\n")
    sensor = open_sensor(url)
    assert not sensor.simulated  # a comment is one, whatever it says
    assert sensor.take().shape == (0, 3)
    leave()
    with pytest.raises(LinkError, match="hung up"):
        take_for_ever(sensor)
    sensor.close()


def take_for_ever(sensor):
    for _ in range(1000):
        sensor.take()
        threading.Event().wait(0.005)


@pytest.mark.parametrize("url", ["socket://nowhere", "tcp://127.0.0.1:99999", "socket://127.0.0.1:1"])
def test_no_sensor_there(url):
    with pytest.raises(LinkError, match=url):
        open_sensor(url)


def test_noise_in_pieces_is_the_same_and_as_large_as_it_should_be():
    whole, pieces = DriftNoise(0.1, seed=1).take(200_000), DriftNoise(0.1, seed=1)
    np.testing.assert_allclose(np.concatenate([pieces.take(count) for count in (0, 1, 5000, 194_999)]), whole)
    assert whole.std(axis=0) == pytest.approx([0.1] * 3, rel=0.2)
