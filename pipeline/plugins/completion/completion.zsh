#compdef flowsculpt
_flowsculpt() {
    local line word
    local -a found described
    found=("${(@f)$(_FLOWSCULPT_COMPLETE=zsh "${words[1]}" "${(@)words[2,CURRENT]}" 2>/dev/null)}")
    for line in $found; do
        word=${line%%$'\t'*}
        if [[ $line == :files ]]; then
            _files
        else
            described+=("${word//:/\:}:${${line#$word}#$'\t'}")
        fi
    done
    (( $#described )) && _describe flowsculpt described
}
if [[ $funcstack[1] == _flowsculpt ]]; then _flowsculpt "$@"; else compdef _flowsculpt flowsculpt; fi
