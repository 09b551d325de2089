from bushseg.errors import BushsegError, ReadError


def test_what_a_file_holds_can_not_break_the_line_or_command_the_terminal():
    error = ReadError("a.ply", "a field \x1b[31m'é\n'\u2028\0", "another")
    assert str(error) == r"a.ply: a field \x1b[31m'é\n'\u2028\x00; expected another"


def test_a_message_without_end_is_cut():
    assert len(str(BushsegError("x" * 10**6))) == 1000
    assert str(BushsegError("x" * 1000)) == "x" * 1000
