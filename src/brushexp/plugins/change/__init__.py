"""Members of ``change=``: what is different about one painting."""
